"""What the embedded vehicle's truth says after each flight."""

import json

from autonomy.embedded import EmbeddedPx4


def test_the_true_clearance_is_that_since_it_was_asked_last() -> None:
    px4 = EmbeddedPx4("empty", 0)

    def write(*states: tuple[float, bool]) -> None:
        with px4.truth_path.open("a", encoding="utf-8") as file:
            for clearance_m, in_air in states:
                file.write(json.dumps({"clearance_m": clearance_m, "in_air": in_air}) + "\n")

    assert px4.true_clearance_m() is None
    write((0.1, False), (0.5, True), (0.3, True))
    assert px4.true_clearance_m() == 0.3
    assert px4.true_clearance_m() is None
    write((0.05, False), (0.7, True))
    assert px4.true_clearance_m() == 0.7
    px4.__exit__()  # removes its folder
