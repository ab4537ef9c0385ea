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
        interpreted=True,
    ),
    "hyperbolic": Target(
        Path("autonomy/t3drm/hyperbolic.py"),
        (f"{T3DRM}/test_hyperbolic.py",),
        interpreted=True,
    ),
    "spherical": Target(
        Path("autonomy/t3drm/spherical.py"),
        (f"{T3DRM}/test_tangents.py",),
        interpreted=True,
    ),
    "conic-kernels": Target(
        KERNELS,
        (f"{T3DRM}/test_kernels_conic.py",),
        frozenset({"eccentricity", "fly_by_anomaly", "sample_conic"}),
        interpreted=True,
    ),
    "guard": Target(
        Path("hal/vehicle/guard.py"),
        tuple(f"{GUARD}{part}.py" for part in ("", "_surfaces", "_borders", "_flights")),
        equivalent=dict.fromkeys(
            (
                "__init__: self._fence_at = (0.0, 0.0) -> self._fence_at = ( -1.0, 0.0)",
                "__init__: self._fence_at = (0.0, 0.0) -> self._fence_at = ( 1.0, 0.0)",
                "__init__: self._fence_at = (0.0, 0.0) -> self._fence_at = (0.0, -1.0)",
                "__init__: self._fence_at = (0.0, 0.0) -> self._fence_at = (0.0, 1.0)",
            ),
            "any place will do: the distance that is remembered is computed for it",
        ),
    ),
    "outline-kernels": Target(
        KERNELS,
        (f"{T3DRM}/test_kernels_outline.py",),
        frozenset(
            {
                "_turn",
                "convex_hull",
                "_circle_of_two",
                "_circle_of_three",
                "_outside",
                "enclosing_circle",
                "regularity",
                "describe",
            }
        ),
        interpreted=True,
    ),
    "component-kernels": Target(
        KERNELS,
        (f"{T3DRM}/test_kernels_components.py",),
        frozenset(
            {
                "spanning_tree",
                "prim_tree",
                "cut_tree",
                "sparse_chain",
                "_cells",
                "_take_overlapping",
                "join_overlapping",
            }
        ),
        interpreted=True,
    ),
    "boxed-tree-kernels": Target(
        KERNELS,
        (f"{T3DRM}/test_kernels_boxed_tree.py",),
        frozenset(
            {
                "_boxes_of",
                "_own_boxes",
                "_box_distance2",
                "_nearest_stranger",
                "_ways_out",
                "_edges_of_boxes",
                "_grown",
                "boxed_tree",
            }
        ),
        interpreted=True,
    ),
    "tangent-kernels": Target(
        KERNELS,
        (f"{T3DRM}/test_kernels_tangents.py", f"{T3DRM}/test_kernels_routes.py"),
        frozenset(
            {
                "segment_distance2",
                "tangent",
                "ahead",
                "_crosses",
                "_edge_is_free",
                "_overlap",
                "_bar",
                "_barred_bearings",
                "_reach",
                "_sift_up",
                "_sift_down",
                "_push",
                "_lay_tangent",
                "_arrival",
                "_dominated",
                "_remember",
            }
        ),
        interpreted=True,
    ),
    "route-kernels": Target(
        KERNELS,
        (f"{T3DRM}/test_kernels_tangents.py", f"{T3DRM}/test_kernels_routes.py"),
        frozenset(
            {
                "_lay_all",
                "solve_tangents",
                "_wider",
                "_chain",
                "_rows",
                "_depth",
                "_box_of",
                "_activate",
                "_note_cut",
                "_deepest_cuts",
                "_add_chain",
                "_inside_which",
                "_buried",
                "_circles_of",
                "_add_cut_discs",
                "lazy_route",
                "route_from_scratch",
            }
        ),
        interpreted=True,
    ),
    "label-kernels": Target(
        KERNELS,
        (f"{T3DRM}/test_classification.py",),
        frozenset({"by_label", "outlines", "regularities_and_deaths"}),
        interpreted=True,
    ),
    "square-kernels": Target(
        KERNELS,
        (f"{T3DRM}/test_kernels_squares.py",),
        frozenset({"into_squares", "_strip", "_columns_of", "points_near", "segment_is_free"}),
        interpreted=True,
    ),
    "flood-kernels": Target(
        KERNELS,
        (f"{T3DRM}/test_kernels_flood.py",),
        frozenset({"_window", "_covered", "_spread", "_meets_free", "_set_aside", "_take_back"}),
        interpreted=True,
    ),
}
