"""`python -m tools.mutation [TARGET ...]`: mutate modules, run their tests, report the score.

Every mutant runs in a copy of the tree; the tree itself is never touched. A mutant that no test
notices is printed. The exit code is 1 when a target's score is below --least.
"""

import argparse
import functools
import os
import sys

from tools.mutation.runner import Score, score_of
from tools.mutation.targets import TARGETS


def main() -> int:
    """Test the named targets, or all."""
    parser = argparse.ArgumentParser(prog="python -m tools.mutation", description=__doc__)
    parser.add_argument("target", nargs="*", help=f"of {', '.join(TARGETS)}; all without")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--sample", type=int, default=0, help="only so many mutants of each")
    parser.add_argument("--least", type=float, default=0.95, help="the score demanded, 0 to 1")
    parser.add_argument("--within", default="", help="only functions whose name contains this")
    asked = parser.parse_args()
    unknown = [name for name in asked.target if name not in TARGETS]
    if unknown:
        parser.error(f"no target {unknown[0]!r}; there are: {', '.join(TARGETS)}")
    scores = []
    for name in asked.target or TARGETS:
        score = score_of(
            name,
            TARGETS[name],
            asked.workers,
            sample=asked.sample,
            within=asked.within,
            tell=functools.partial(print, flush=True),
        )
        scores.append(score)
    print(table(scores))
    return int(any(score.share < asked.least for score in scores))


def table(scores: list[Score]) -> str:
    """The scores as a Markdown table."""
    rows = [
        "| target | mutants | killed | equivalent | score | comparisons and signs |",
        "|---|---|---|---|---|---|",
    ]
    rows += [
        f"| {s.target} | {s.mutants} | {s.killed} | {s.equivalent} "
        f"| {100.0 * s.share:.1f} % | {100.0 * s.share_of_decisions:.1f} % |"
        for s in scores
    ]
    return "\n".join(rows)


if __name__ == "__main__":
    sys.exit(main())
