"""Fly for hours and look at what grows.

python -m tools.soak simulated [--hours 5] [--write]
python -m tools.soak real [--minutes 30] [--write]
"""

import argparse
import datetime
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tools import pages
from tools.soak import flying
from tools.soak.sample import Sample, growth, is_flat

README = Path(__file__).with_name("README.md")


def main(arguments: list[str] | None = None) -> int:
    """Parse, fly, print, draw; the exit code is 1 when something grew."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.soak",
        description=__doc__,
        allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="soak", required=True)
    simulated = commands.add_parser("simulated", help="in process, as fast as it goes")
    simulated.add_argument("--hours", type=float, default=5.0, help="of simulated flight")
    real = commands.add_parser("real", help="autonomy serve over MAVSDK, in real time")
    real.add_argument("--minutes", type=float, default=30.0)
    for command in (simulated, real):
        command.add_argument("--write", action="store_true", help="renew tools/soak/README.md")
    options = parser.parse_args(arguments)
    if options.write:
        pages.must_have(options.soak, README)
    if options.soak == "simulated":
        samples = flying.simulated(options.hours, tell)
        title = f"{options.hours:g} h of simulated flight, {samples[-1].missions} missions"
    else:
        samples, endings = flying.real(options.minutes, tell)
        counted = ", ".join(f"{n} {name}" for name, n in Counter(endings).items())
        title = f"{options.minutes:g} min of `autonomy serve` over MAVSDK, {counted}"
    text = section(title, samples)
    print(text)
    if options.write:
        pages.renew(options.soak, text, README)
        draw(samples, README.with_name(f"{options.soak}.png"))
    return int(not is_flat(samples))


def tell(line: str) -> None:
    """Progress, where it does not get into the result."""
    print(line, file=sys.stderr, flush=True)


def section(title: str, samples: Sequence[Sample]) -> str:
    """The table, as Markdown."""
    when = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    lines = [
        f"{title}. Measured {when}, {flying.machine()}: {'flat' if is_flat(samples) else 'GROWS'}.",
        "",
        "| after the first fifth | at the beginning | at the end | growth per 100 missions |",
        "|---|--:|--:|--:|",
    ]
    for what, label in (
        ("rss_mb", "resident memory, MB"),
        ("files", "open files"),
        ("threads", "threads"),
        ("lag_ms", "loop lag, nine tenths below, ms"),
    ):
        if all(getattr(sample, what) != getattr(sample, what) for sample in samples):
            continue
        first, last, slope = growth(samples, what)
        lines.append(f"| {label} | {first:.1f} | {last:.1f} | {slope:+.3f} |")
    return "\n".join(lines)


def draw(samples: Sequence[Sample], path: Path) -> None:
    """Everything that was sampled, over time, one above the other."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    rows = [("rss_mb", "memory, MB"), ("files", "files"), ("threads", "threads")]
    if any(sample.lag_ms == sample.lag_ms for sample in samples):
        rows.append(("lag_ms", "loop lag, ms"))
    figure, all_axes = plt.subplots(
        len(rows), 1, figsize=(8.0, 1.3 * len(rows) + 0.5), sharex=True, layout="constrained"
    )
    minutes = [sample.at_s / 60.0 for sample in samples]
    for axes, (what, label) in zip(all_axes, rows, strict=True):
        values = [getattr(sample, what) for sample in samples]
        axes.plot(minutes, values, color="#0969da", lw=1.0)
        axes.set_ylim(bottom=0.0)
        axes.set_title(label, loc="left", fontsize=9)
        axes.grid(color="#d0d7de", lw=0.4)
        axes.spines[["top", "right"]].set_visible(False)
    all_axes[-1].set_xlabel(f"minutes ({samples[-1].missions} missions)")
    figure.savefig(path, dpi=100, metadata={"Software": None})
    plt.close(figure)


if __name__ == "__main__":
    sys.exit(main())
