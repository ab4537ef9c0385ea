"""What is mutated, which tests have to notice, and which mutants change nothing."""

from dataclasses import dataclass, field
from pathlib import Path

KERNELS = Path("autonomy/t3drm/kernels.py")
GUARD = "tests/unit/hal/vehicle/test_guard"
T3DRM = "tests/unit/autonomy/t3drm"


@dataclass(frozen=True)
class Target:
    """A module (or some functions of it) and the tests that must fail when it is mutated.

    `definitions` empty means the whole module. With `interpreted` the tests run without numba's
    compiler: a compiled kernel would take seconds to compile for every mutant.
    """

    module: Path
    tests: tuple[str, ...]
    definitions: frozenset[str] = frozenset()
    interpreted: bool = False
    equivalent: dict[str, str] = field(default_factory=dict)
    """Mutants that compute the same: "function: old line -> new line" and why."""
    flat: frozenset[str] = frozenset()
    """Names of one-dimensional arrays: their shape[0] is shape[-1]."""

    def is_equivalent(self, change: str) -> bool:
        """Whether the mutant is known to compute the same."""
        old, _, new = change.partition(": ")[2].partition(" -> ")
        return change in self.equivalent or any(
            old.replace(f"{name}.shape[0]", f"{name}.shape[ -1]", 1) == new
            for name in self.flat
            if f"{name}.shape[0]" in old
        )


FLAT = frozenset(
    (
        *("labels", "members", "first", "order", "counts", "active", "chain", "flags", "radii"),
        *("near", "found", "keys", "came", "heads", "ids", "edges", "gap", "parent"),
    )
)
"""One-dimensional arrays of the kernels, by the names that they have everywhere."""


def _kernels(tests: str, *definitions: str) -> Target:
    """Kernels and their tests."""
    return Target(
        KERNELS,
        (f"{T3DRM}/test_kernels_{tests}.py",),
        frozenset(definitions),
        interpreted=True,
        flat=FLAT,
    )


def _same(reason: str, line: str, *mutants: str) -> dict[str, str]:
    """Mutants of one line ("function: old line") that compute the same."""
    return {f"{line} -> {mutant}": reason for mutant in mutants}


_PART = "accelerated: part = (north * before_n + east * before_e) / square if square > 0.0 else 0.0"


def _guard(module: str, equivalent: dict[str, str] | None = None) -> Target:
    """One module of the guard; all of its tests are asked."""
    parts = ("", "_surfaces", "_borders", "_flights", "_pace")
    return Target(
        Path(f"hal/vehicle/guard/{module}.py"),
        tuple(f"{GUARD}{part}.py" for part in parts),
        equivalent=equivalent or {},
    )


TARGETS: dict[str, Target] = {
    "direction": Target(
        Path("autonomy/t3drm/direction.py"),
        (f"{T3DRM}/test_direction.py", "tests/paper/test_tables.py"),
    ),
    "speed": Target(
        Path("autonomy/t3drm/speed.py"),
        (f"{T3DRM}/test_speed.py", "tests/paper/test_tables.py"),
    ),
    "classification": Target(
        Path("autonomy/t3drm/classification.py"),
        (f"{T3DRM}/test_classification.py",),
        flat=frozenset({"self.edge_m"}),
    ),
    "hyperbolic": Target(
        Path("autonomy/t3drm/hyperbolic.py"),
        (f"{T3DRM}/test_hyperbolic.py",),
        interpreted=True,
        equivalent=_same(
            "more than 0, unless rounding makes it negative and huge; 1e9 is any large number",
            "fly_by: if not 0.0 <= eccentricity < 1e9:",
            "if not -1.0 <= eccentricity < 1e9:",
            "if not 0.0 < eccentricity < 1e9:",
            "if not 0.0 <= eccentricity <= 1e9:",
            "if not 0.0 <= eccentricity < 1000000001.0:",
            "if not 0.0 <= eccentricity < 999999999.0:",
        ),
    ),
    "spherical": Target(
        Path("autonomy/t3drm/spherical.py"),
        (f"{T3DRM}/test_tangents.py",),
        interpreted=True,
        equivalent=_same(
            "a cosine does not mind the sign",
            "polyline: outer = self.radius_m / math.cos(0.5 * step)",
            "outer = self.radius_m / math.cos( -0.5 * step)",
        )
        | _same(
            "both are vectors of three",
            "tangent_cone: axis = tuple(c - d for c, d in "
            "zip(centre_ned_m, drone_ned_m, strict=True))",
            "axis = tuple(c - d for c, d in zip(centre_ned_m, drone_ned_m, strict=False))",
        ),
        flat=frozenset({"radii"}),
    ),
    "conic-kernels": _kernels("conic", "eccentricity", "fly_by_anomaly", "sample_conic"),
    "outline-kernels": _kernels(
        "outline",
        *("_turn", "convex_hull", "_circle_of_two", "_circle_of_three", "_outside"),
        *("enclosing_circle", "regularity", "describe"),
        *("by_label", "outlines", "regularities_and_deaths"),
    ),
    "component-kernels": _kernels(
        "components",
        "prim_tree",
        "cut_tree",
        "sparse_chain",
        "_take_overlapping",
        "join_overlapping",
    ),
    "tangent-kernels": _kernels(
        "tangents",
        *("segment_distance2", "tangent", "ahead", "_crosses", "_edge_is_free", "_overlap"),
        *("_bar", "_barred_bearings", "_reach", "_sift_up", "_sift_down", "_push"),
        *("_lay_tangent", "_arrival", "_dominated", "_remember"),
        *("_depth", "_box_of", "_inside_which"),
    ),
    "route-kernels": _kernels(
        "routes",
        *("_lay_all", "solve_tangents", "_wider", "_chain", "_rows", "_activate"),
        *("_note_cut", "_deepest_cuts", "_add_chain", "_buried", "_circles_of"),
        *("_add_cut_discs", "lazy_route", "route_from_scratch"),
    ),
    "square-kernels": _kernels(
        "squares", "into_squares", "_strip", "_columns_of", "points_near", "segment_is_free"
    ),
    "guard": _guard("guard"),
    "guard-sight": _guard("sight"),
    "guard-stopping": _guard("stopping"),
    "guard-pace": _guard(
        "pace",
        _same(
            "before the first setpoint the vehicle counts as being at rest, whatever stands here",
            "__init__: self._before = self._sent = (0.0, 0.0)",
            *(
                "self._before = self._sent = ( -1.0, 0.0)",
                "self._before = self._sent = ( 1.0, 0.0)",
            ),
            *("self._before = self._sent = (0.0, -1.0)", "self._before = self._sent = (0.0, 1.0)"),
        )
        | _same(
            "the first setpoint is always a new one",
            "__init__: self._asked_since_s = -math.inf",
            "self._asked_since_s = +math.inf",
        )
        | _same(
            "any part of a velocity of zero is zero",
            _PART,
            _PART.partition(": ")[2].replace("else 0.0", "else 1.0"),
            _PART.partition(": ")[2].replace("else 0.0", "else -1.0"),
        )
        | _same(
            "no sum of angles is exactly as far off as rounding may be",
            "turned: if abs(asked - allowed) <= _ROUNDING:",
            "if abs(asked - allowed) < _ROUNDING:",
        ),
    ),
    "guard-around": _guard("around"),
    "guard-room": _guard(
        "room",
        _same(
            "three times the same corridor",
            "_seen_m: asides = (0.0,) if aside_m <= 0.0 else (0.0, aside_m, -aside_m)",
            "asides = (0.0,) if aside_m < 0.0 else (0.0, aside_m, -aside_m)",
        )
        | _same(
            "less than nothing allows no more than nothing",
            "_seen_m: reach_m = min(reach_m, seen_m) if seen_m > 0.0 else 0.0",
            "reach_m = min(reach_m, seen_m) if seen_m >= 0.0 else 0.0",
            "reach_m = min(reach_m, seen_m) if seen_m > -1.0 else 0.0",
            "reach_m = min(reach_m, seen_m) if seen_m > 0.0 else -1.0",
        ),
    ),
    "guard-fence": _guard(
        "fence_ahead",
        _same(
            "any place will do: the distance that is remembered is computed for it",
            "__init__: self._known_at = (0.0, 0.0)",
            *("self._known_at = ( -1.0, 0.0)", "self._known_at = ( 1.0, 0.0)"),
            *("self._known_at = (0.0, -1.0)", "self._known_at = (0.0, 1.0)"),
        )
        | _same(
            "then the distance is computed anew",
            "distance_m: if self._known_inside_m - travelled_m >= reach_m:",
            "if self._known_inside_m - travelled_m > reach_m:",
        ),
    ),
    "guard-vertical": _guard(
        "vertical",
        _same(
            "where nothing is allowed both ways give nothing; equal is no limit",
            "limited: if allowed * effective >= 0.0 and abs(allowed) < abs(effective):",
            "if allowed * effective > 0.0 and abs(allowed) < abs(effective):",
            "if allowed * effective >= 0.0 and abs(allowed) <= abs(effective):",
        )
        | _same(
            "only saves making an equal setpoint",
            "limited: if reason is None and rise == -offset[2]:",
            "if reason is None and rise == +offset[2]:",
        ),
    ),
}
