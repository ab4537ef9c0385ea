"""What a command writes into a page that people write, too: the text between two markers."""

from pathlib import Path


def renewed(page: str, section: str, text: str, name: str = "the page") -> str:
    """`page` with `text` between the markers of `section`; ValueError when it has none.

    The markers are `<!-- SECTION: begin -->` and `<!-- SECTION: end -->`; `name` is the page's.
    """
    begin, end = f"<!-- {section}: begin -->", f"<!-- {section}: end -->"
    before, found, rest = page.partition(begin)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise ValueError(
            f"{name} has no place for {section}: the markers {begin} and {end} are missing"
        )
    return f"{before}{begin}\n\n{text}\n\n{end}{after}"


def renew(section: str, text: str, page: Path) -> None:
    """As `renewed`, in a file."""
    whole = page.read_text(encoding="utf-8")
    page.write_text(renewed(whole, section, text, str(page)), encoding="utf-8")


def must_have(section: str, page: Path) -> None:
    """Before hours of work for it: ends the program in a sentence where the page has no place."""
    try:
        renewed(page.read_text(encoding="utf-8"), section, "", str(page))
    except ValueError as error:
        raise SystemExit(str(error)) from None
