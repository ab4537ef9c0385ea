"""What the paper prints in Tables 4 to 7, and what follows from it.

"Fast and Efficient Drone Path Planning Using Riemannian Manifold in Indoor Environment",
Automation 2024, 5(3), 450-466, doi 10.3390/automation5030026.
"""

import msgspec

SPEED_M_S = 0.2
TRIALS = 20


class Flown(msgspec.Struct, frozen=True):
    """A row of Table 4 and its row of Table 5: simulation against flight."""

    scenario: int
    simulated_m: float
    flown_m: float
    length_deviation: float
    simulated_s: float
    flown_s: float
    time_deviation: float


class Compared(msgspec.Struct, frozen=True):
    """A row of Table 6 and its row of Table 7: T3DRM against another planner.

    Lengths are in the drawing's units, `unit_m` of which make the arena 6 m wide in our reading;
    times are in seconds, for whatever the drawing's unit was.
    """

    scenario: int
    other: str
    start: tuple[float, float]
    goal: tuple[float, float]
    unit_m: float
    t3drm: float
    others: float
    saved: float
    t3drm_s: float
    others_s: float
    time_saved: float

    @property
    def straight(self) -> float:
        """From start to goal, in the same units."""
        (x0, y0), (x1, y1) = self.start, self.goal
        return float(((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5)


FLOWN = (
    Flown(1, 6.1389, 6.4414, 0.0469, 31.33, 32.9, 0.0477),
    Flown(2, 7.6132, 7.9957, 0.0478, 35.63, 37.5, 0.0498),
)
FIELD, ANTS = "potential field", "ant colony"
COMPARED = (
    Compared(3, FIELD, (8, 88), (87, 7), 0.06, 130.25, 140.04, 0.0752, 7.3, 7.7, 0.054),
    Compared(4, FIELD, (12, 90), (87, 7), 0.06, 139.5, 153.42, 0.0998, 8.1, 8.8, 0.086),
    Compared(5, ANTS, (1, 9), (7.5, 1.5), 0.6, 14.6, 15.47, 0.02, 7.9, 7.04, 0.06),
)


def deviation(simulated: float, flown: float) -> float:
    """As the paper calculates it: of what was flown."""
    return abs(flown - simulated) / flown


def saved(t3drm: float, other: float) -> float:
    """What T3DRM saves of the other's way; negative where it loses. (The paper: of its own.)"""
    return (other - t3drm) / other
