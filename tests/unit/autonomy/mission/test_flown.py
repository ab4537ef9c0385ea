"""Which legs were flown at which radius: what was planned and not flown does not count."""

import itertools

import pytest

from autonomy.geometry import Point, distance
from autonomy.mission.flown import FlownLeg, FlownLegs, by_radius
from autonomy.model import Environment, Leg, LegKind, Plan


def leg(kind: LegKind, keep_out_m: float, *points: Point) -> Leg:
    length_m = sum(distance(a, b) for a, b in itertools.pairwise(points))
    return Leg(kind, points, length_m, keep_out_m)


def plan(*legs: Leg) -> Plan:
    return Plan(legs, sum(x.length_m for x in legs), legs[-1].keep_out_m, Environment.FREE, ())


def fly(legs: FlownLegs, *points: Point, begin_s: float = 0.0) -> None:
    for k, (a, b) in enumerate(itertools.pairwise(points)):
        legs.moved(begin_s + k + 1.0, b, distance(a, b))


WIDE, NARROW = 0.23, 0.2
ROUND = plan(
    leg(LegKind.TANGENT, WIDE, (0.0, 0.0), (1.0, 0.0)),
    leg(LegKind.ARC, WIDE, (1.0, 0.0), (1.2, 0.1), (1.3, 0.3)),
    leg(LegKind.TANGENT, WIDE, (1.3, 0.3), (1.3, 1.3)),
)
THROUGH = plan(
    leg(LegKind.STRAIGHT, 0.17, (1.0, 0.0), (1.1, 0.0)),
    leg(LegKind.STRAIGHT, NARROW, (1.1, 0.0), (3.0, 0.0)),
)


def test_legs_are_told_in_the_order_flown_with_radius_and_length() -> None:
    legs = FlownLegs()
    legs.planned(ROUND)
    fly(legs, (0.0, 0.0), (0.5, 0.01), (0.9, 0.0), (1.2, 0.1), (1.3, 0.5), (1.3, 1.2))
    flown = legs.record()
    assert [(x.kind, x.keep_out_m, x.begun_s) for x in flown] == [
        (LegKind.TANGENT, WIDE, 1.0),
        (LegKind.ARC, WIDE, 3.0),
        (LegKind.TANGENT, WIDE, 4.0),
    ]
    assert [x.flown_m for x in flown] == pytest.approx([0.9, 0.316, 1.112], abs=2e-3)


def test_a_leg_that_a_replan_replaced_counts_only_as_far_as_it_was_flown() -> None:
    legs = FlownLegs()
    legs.planned(ROUND)
    fly(legs, (0.0, 0.0), (0.5, 0.0), (1.0, 0.0))
    legs.planned(THROUGH)
    fly(legs, (1.0, 0.0), (1.08, 0.0), (1.5, 0.0), (2.0, 0.0), begin_s=10.0)
    flown = legs.record()
    assert [(x.begun_s, x.kind, x.keep_out_m) for x in flown] == [
        (1.0, LegKind.TANGENT, WIDE),
        (11.0, LegKind.STRAIGHT, 0.17),
        (12.0, LegKind.STRAIGHT, NARROW),
    ]
    assert [x.flown_m for x in flown] == pytest.approx([1.0, 0.08, 0.92])


def test_going_on_in_the_same_way_after_a_replan_is_one_leg() -> None:
    legs = FlownLegs()
    straight = plan(leg(LegKind.STRAIGHT, WIDE, (0.0, 0.0), (3.0, 0.0)))
    legs.planned(straight)
    fly(legs, (0.0, 0.0), (1.0, 0.0))
    legs.planned(plan(leg(LegKind.STRAIGHT, WIDE, (1.0, 0.0), (3.0, 0.0))))
    fly(legs, (1.0, 0.0), (2.0, 0.0))
    assert [x.flown_m for x in legs.record()] == [2.0]


def test_before_a_plan_nothing_was_flown_and_past_its_end_it_is_the_last_leg() -> None:
    legs = FlownLegs()
    fly(legs, (0.0, 0.0), (1.0, 0.0))
    assert legs.record() == ()
    legs.planned(ROUND)
    fly(legs, (1.3, 0.9), (1.3, 1.25), (1.3, 1.5))
    assert legs.record()[-1].kind is LegKind.TANGENT


def test_a_curve_that_is_longer_than_it_says_ends_with_the_last_leg() -> None:
    legs = FlownLegs()
    short = Leg(LegKind.HYPERBOLA, ((0.0, 0.0), (1.0, 0.0)), 0.99, WIDE)
    legs.planned(plan(short))
    fly(legs, (0.0, 0.0), (0.5, 0.0), (0.995, 0.0), (1.0, 0.0))
    assert [(x.kind, x.flown_m) for x in legs.record()] == [(LegKind.HYPERBOLA, 1.0)]


def test_metres_by_radius_begin_at_the_comfortable_one() -> None:
    legs = (
        FlownLeg(0.0, LegKind.ARC, NARROW, 0.25),
        FlownLeg(1.0, LegKind.ARC, WIDE, 1.0),
        FlownLeg(2.0, LegKind.STRAIGHT, NARROW + 1e-6, 0.5),
    )
    assert by_radius(legs) == ((WIDE, 1.0), (NARROW, 0.75))
    assert by_radius(()) == ()
