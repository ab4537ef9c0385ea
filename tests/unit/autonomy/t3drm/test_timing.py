from autonomy.t3drm.timing import ComputationTime, flow_radius_m


def test_before_the_first_replan_there_is_a_start_and_nothing_else() -> None:
    record = ComputationTime(start_s=3.0).record()
    assert (record.start_s, record.replans, record.total_s) == (3.0, (), 0.0)
    assert record.least_s is None
    assert record.completed_s is None
    assert record.flight_s is None


def test_the_first_completion_counts() -> None:
    times = ComputationTime(start_s=0.0)
    times.completed(5.0)
    times.completed(9.0)
    assert times.record().completed_s == 5.0


def test_a_record_does_not_change_when_more_is_measured() -> None:
    times = ComputationTime(start_s=0.0)
    times.replanned(1.0, 0.1, 1, 0.2)
    before = times.record()
    times.replanned(2.0, 0.1, 1, 0.2)
    assert len(before.replans) == 1


def test_no_obstacle_or_an_extinct_sphere_has_no_radius() -> None:
    assert flow_radius_m(0.2, 0) is None
    assert flow_radius_m(0.015, 1) is None  # 1.5 cm: 2.25 - 4 < 0
    assert flow_radius_m(0.021, 1) is not None
    assert flow_radius_m(0.021, 2) is None  # 2.1 cm: 4.41 - 12 < 0
