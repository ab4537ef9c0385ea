"""Equations 1 to 9 as worked examples."""

import math

import pytest

from autonomy.t3drm import ricci


def test_equation_1_a_round_sphere_shrinks_as_its_ricci_curvature_says() -> None:
    # dg/dt = -2 Ric with g = r^2 g_unit and Ric = (n-1)/r^2 g: d(r^2)/dt = -2 (n-1).
    for n in (2, 3):
        r, dt = 0.7, 1e-7
        slope = (ricci.shrinking_radius(r, dt, n) ** 2 - r * r) / dt
        assert slope == pytest.approx(-2.0 * ricci.sphere_ricci(r, n) * r * r, rel=1e-6)


def test_equation_2_in_three_dimensions() -> None:
    assert ricci.shrinking_radius(5.0, 4.0, 3) == pytest.approx(3.0)  # sqrt(25 - 4 * 4)


def test_equation_2_ends_at_extinction() -> None:
    end = ricci.extinction_time(0.23, 3)
    assert end == pytest.approx(0.23**2 / 4.0)
    assert ricci.shrinking_radius(0.23, end * (1.0 - 1e-12), 3) == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(ricci.ExtinctSphere, match="after extinction"):
        ricci.shrinking_radius(0.23, 1.001 * end, 3)


def test_equation_3_the_square_of_the_radius_grows_at_a_constant_rate() -> None:
    assert ricci.growth_rate(3) == 4.0
    assert ricci.growth_rate(2) == 2.0


def test_equation_4_solves_equation_3() -> None:
    assert ricci.growing_radius(3.0, 4.0, 3) == pytest.approx(5.0)
    assert ricci.shrinking_radius(ricci.growing_radius(0.4, 0.1), 0.1) == pytest.approx(0.4)


def test_equation_5_straight_lines_are_fixed_points() -> None:
    assert ricci.curve_flow((1.0, 2.0, 3.0), (0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)


def test_equation_5_uses_the_printed_diagonal() -> None:
    # cubes 1, 8, 27 with sum 36; the diagonal is z, y, x.
    flow = ricci.curve_flow((1.0, 2.0, 3.0), (36.0, 36.0, 36.0))
    assert flow == pytest.approx((27.0, 8.0, 1.0))


@pytest.mark.parametrize("first", [(1.0, -1.0, 0.0), (0.0, 0.0, 0.0), (1.0, 1.0, -(2 ** (1 / 3)))])
def test_equation_5_is_refused_where_its_matrix_is_singular(
    first: tuple[float, float, float],
) -> None:
    with pytest.raises(ricci.SingularFlow):
        ricci.curve_flow(first, (1.0, 1.0, 1.0))


def test_equation_7_a_sphere_of_constant_volume_stands_still() -> None:
    for n in (2, 3):
        assert ricci.normalised_flow(0.5, 0.0, n) == 0.0


def test_equation_7_is_the_difference_between_local_and_averaged_curvature() -> None:
    # Finite difference of 2 (n-1) / r^2 over one small change of volume, n = 3.
    r, rate = 0.5, 1e-6
    volume = 4.0 / 3.0 * math.pi * r**3
    larger = (3.0 * (volume + rate) / (4.0 * math.pi)) ** (1.0 / 3.0)
    difference = 4.0 / larger**2 - 4.0 / r**2
    assert ricci.normalised_flow(r, rate, 3) == pytest.approx(difference, rel=1e-4)


def test_equations_8_and_9() -> None:
    # R0 = 23 (cm), n = 3: sqrt(529 - 4) and sqrt(529 - 12).
    assert ricci.one_obstacle_radius(23.0, 3) == pytest.approx(math.sqrt(525.0))
    assert ricci.many_obstacles_radius(23.0, 3) == pytest.approx(math.sqrt(517.0))


def test_equations_8_and_9_are_equation_2_at_times_1_and_n() -> None:
    for n in (2, 3):
        assert ricci.one_obstacle_radius(23.0, n) == pytest.approx(
            ricci.shrinking_radius(23.0, 1.0, n)
        )
        assert ricci.many_obstacles_radius(23.0, n) == pytest.approx(
            ricci.shrinking_radius(23.0, float(n), n)
        )


def test_equations_8_and_9_name_an_extinct_sphere_instead_of_a_nan() -> None:
    assert ricci.one_obstacle_radius(1.9, 3) is None
    assert ricci.one_obstacle_radius(2.0, 3) == 0.0
    assert ricci.many_obstacles_radius(3.4, 3) is None
