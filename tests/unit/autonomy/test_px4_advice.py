"""What PX4's parameters should be, by version and by where the position comes from."""

import pytest

from autonomy.config import Config
from autonomy.finding import Finding
from autonomy.px4_advice import (
    ADVICE,
    Situation,
    about_version,
    kinds,
    parameter_findings,
    version_of,
)

GOOD = {
    "COM_OBL_RC_ACT": 5.0,
    "COM_OF_LOSS_T": 1.0,
    "NAV_DLL_ACT": 1.0,
    "MPC_XY_P": 0.95,
    "COM_TAKEOFF_ACT": 0.0,
    "NAV_RCL_ACT": 1.0,
    "COM_RCL_EXCEPT": 0.0,
    "COM_RC_OVERRIDE": 3.0,
    "MAN_OVERRIDE_SPD": 1.0,
    "COM_RC_IN_MODE": 0.0,
    "RTL_RETURN_ALT": 1.5,
    "MPC_XY_VEL_MAX": 1.0,
    "MPC_Z_VEL_MAX_UP": 1.0,
    "MPC_Z_V_AUTO_UP": 1.0,
    "GF_ACTION": 2.0,
    "COM_LOW_BAT_ACT": 2.0,
    "BAT_CRIT_THR": 0.07,
    "SYS_HAS_GPS": 1.0,
    "COM_ARM_WO_GPS": 1.0,
    "EKF2_HGT_REF": 0.0,
    "CP_DIST": -1.0,
    "EKF2_GPS_CTRL": 7.0,
    "EKF2_OF_CTRL": 0.0,
    "EKF2_EV_CTRL": 0.0,
}
WITH_GNSS = Situation(Config(), global_position=True, has_gnss=True)
LOCAL_ONLY = Situation(Config(), global_position=False, has_gnss=False)
MAIN = (1, 19)


def wrong(
    situation: Situation = WITH_GNSS,
    version: tuple[int, int] | None = MAIN,
    **changes: float,
) -> list[Finding]:
    found = parameter_findings(version, GOOD | changes, situation)
    return [finding for finding in found if not finding.good]


def only(found: list[Finding]) -> Finding:
    assert len(found) == 1, found
    return found[0]


def test_good_parameters_are_all_told_and_none_is_blamed() -> None:
    assert wrong() == []
    told = {finding.subject for finding in parameter_findings(MAIN, GOOD, WITH_GNSS)}
    assert told == {a.name for a in ADVICE if a.in_version(MAIN)} | {"EKF2"}


@pytest.mark.parametrize(
    ("name", "value", "better", "grave"),
    [
        ("COM_OBL_RC_ACT", 0.0, 5.0, True),
        ("COM_OBL_RC_ACT", 6.0, 5.0, True),
        ("COM_OF_LOSS_T", 1.5, 1.0, True),
        ("NAV_DLL_ACT", 2.0, 1.0, True),
        ("NAV_DLL_ACT", 6.0, 1.0, True),
        ("MPC_XY_P", 1.2, 0.95, True),
        ("NAV_RCL_ACT", 2.0, 1.0, False),
        ("COM_RCL_EXCEPT", 7.0, 3.0, False),
        ("MAN_OVERRIDE_SPD", -1.0, 1.0, False),
        ("RTL_RETURN_ALT", 30.0, 2.0, False),
        ("MPC_XY_VEL_MAX", 12.0, 1.0, False),
        ("MPC_XY_VEL_MAX", 0.3, 1.0, False),
        ("MPC_Z_VEL_MAX_UP", 3.0, 1.0, False),
        ("GF_ACTION", 3.0, 2.0, False),
        ("COM_LOW_BAT_ACT", 3.0, 2.0, False),
        ("COM_LOW_BAT_ACT", 5.0, 2.0, False),
        ("BAT_CRIT_THR", 0.2, 0.07, False),
    ],
)
def test_each_wrong_value_has_a_better_one_and_a_reason(
    name: str, value: float, better: float, grave: bool
) -> None:
    finding = only(wrong(WITH_GNSS, MAIN, **{name: value}))
    assert finding.subject == name
    assert finding.grave is grave
    assert finding.sentence.startswith(f"{name} is {value:g}, better {better:g}: ")
    assert finding.fix is not None
    assert finding.fix.old == value
    assert finding.fix.new == pytest.approx(better)


@pytest.mark.parametrize("name", [advice.name for advice in ADVICE])
def test_what_is_recommended_is_good(name: str) -> None:
    (advice,) = (advice for advice in ADVICE if advice.name == name)
    for situation in (WITH_GNSS, LOCAL_ONLY):
        for value in (-1.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 30.0):
            wanted = advice.want(value, situation)
            if wanted is not None:
                assert advice.want(wanted, situation) is None, (value, wanted)


@pytest.mark.parametrize("speed_max_m_s", [0.25, 0.9, 1.5, 4.0])
def test_the_fastest_that_others_may_fly_is_never_below_what_the_guard_needs(
    speed_max_m_s: float,
) -> None:
    config = Config()
    guard = config.guard.model_copy(update={"speed_max_m_s": speed_max_m_s})
    situation = Situation(config.model_copy(update={"guard": guard}), True, True)
    (advice,) = (advice for advice in ADVICE if advice.name == "MPC_XY_VEL_MAX")
    wanted = advice.want(12.0, situation)
    assert wanted is not None
    assert wanted >= 2.0 * speed_max_m_s
    assert advice.want(wanted, situation) is None


def test_sticks_take_over_by_another_parameter_since_1_18() -> None:
    before = {f.subject for f in wrong(version=(1, 17), COM_RC_OVERRIDE=1.0, MAN_OVERRIDE_SPD=-1.0)}
    since = {f.subject for f in wrong(version=(1, 18), COM_RC_OVERRIDE=1.0, MAN_OVERRIDE_SPD=-1.0)}
    assert before == {"COM_RC_OVERRIDE"}
    assert since == {"MAN_OVERRIDE_SPD"}
    assert "COM_RC_OVERRIDE" in kinds((1, 17))
    assert "COM_RC_OVERRIDE" not in kinds((1, 18))
    assert {"COM_RC_OVERRIDE", "MAN_OVERRIDE_SPD"} <= set(kinds(None))


def test_a_take_off_that_begins_a_mission_is_grave_while_there_is_such_a_choice() -> None:
    assert only(wrong(version=(1, 16), COM_TAKEOFF_ACT=1.0)).grave
    assert wrong(version=(1, 18), COM_TAKEOFF_ACT=1.0) == []


def test_without_a_global_position_px4_cannot_hold_so_it_should_land() -> None:
    local = {"SYS_HAS_GPS": 0.0, "EKF2_EV_CTRL": 15.0}
    finding = only(wrong(LOCAL_ONLY, MAIN, **local))
    assert finding.subject == "COM_OBL_RC_ACT"
    assert finding.fix is not None
    assert finding.fix.new == 4.0
    assert wrong(LOCAL_ONLY, MAIN, COM_OBL_RC_ACT=4.0, **local) == []


def test_without_gnss_what_waits_for_it_is_named() -> None:
    found = wrong(LOCAL_ONLY, COM_OBL_RC_ACT=4.0, COM_ARM_WO_GPS=0.0, EKF2_HGT_REF=1.0)
    assert [f.subject for f in found] == ["SYS_HAS_GPS", "COM_ARM_WO_GPS", "EKF2_HGT_REF", "EKF2"]
    assert "EKF2_OF_CTRL" in found[-1].sentence
    assert found[2].fix is None, "where the height comes from is not for a program to decide"


def test_a_parameter_that_is_not_told_matters_only_where_safety_does() -> None:
    told = dict(GOOD)
    del told["COM_OBL_RC_ACT"], told["CP_DIST"]
    found = [f for f in parameter_findings(MAIN, told, WITH_GNSS) if not f.good]
    assert only(found).subject == "COM_OBL_RC_ACT"
    assert only(found).bad


def test_collision_prevention_is_named_where_virtual_obstacles_are_sent() -> None:
    driver = {"driver": "virtual", "scenario": "default", "send": True}
    sending = Situation(
        Config.model_validate({"beams": {"drivers": [driver]}}), global_position=True, has_gnss=True
    )
    assert only(wrong(sending, CP_DIST=2.0)).subject == "CP_DIST"
    assert wrong(CP_DIST=2.0) == []


@pytest.mark.parametrize(
    ("text", "version", "good", "bad"),
    [
        ("1.13.3", (1, 13), False, True),
        ("1.14.0", (1, 14), True, False),
        ("1.19.0", (1, 19), True, False),
        ("1.20.1", (1, 20), False, False),
        ("unknown", None, False, False),
    ],
)
def test_versions_that_the_advice_does_not_know_are_named(
    text: str, version: tuple[int, int] | None, good: bool, bad: bool
) -> None:
    assert version_of(text) == version
    finding = about_version(text)
    assert (finding.good, finding.bad) == (good, bad)


def test_every_row_has_a_source() -> None:
    for advice in ADVICE:
        assert advice.source, advice.name
        assert advice.since < advice.before
    assert len({advice.name for advice in ADVICE}) == len(ADVICE)
