"""Monte Carlo runs of the estimator; `--write` puts what they say into its README."""

import argparse

from tools import pages
from tools.estimation import flights, page
from tools.estimation.consistency import consistency


def main() -> None:
    """Parse, run, print; with --write the page is renewed as well."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.estimation", description=__doc__, allow_abbrev=False
    )
    parser.add_argument("--runs", type=int, default=400, help="for NEES and NIS")
    parser.add_argument("--flights", type=int, default=50, help="of every row of the table")
    parser.add_argument("--seconds", type=float, default=20.0, help="of a run for NEES and NIS")
    parser.add_argument("--write", action="store_true", help="renew page and picture")
    options = parser.parse_args()
    if options.write:
        pages.must_have("measured", page.README)
    series = consistency(options.runs, options.seconds)
    flown = [
        (case, [flights.fly(case, seed) for seed in range(options.flights)])
        for case in flights.CASES
    ]
    text = "\n\n".join(
        (page.consistency_table(series), page.error_table(flown), page.room_words(flown))
    )
    print(text)
    if options.write:
        drifting = next(runs for case, runs in flown if case.gnss_drift_m_s == 0.5)
        (state, _), (drift, _) = page.PICTURES
        page.draw_consistency(series, page.README.with_name(state))
        page.draw_drift(drifting[0], page.README.with_name(drift))
        shown = "\n".join(f"![{title}]({name})" for name, title in page.PICTURES)
        pages.renew("measured", f"{text}\n\n{shown}", page.README)


if __name__ == "__main__":
    main()
