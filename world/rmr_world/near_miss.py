"""The known word that a wrong one may stand for."""


def near_miss(word: str, known: list[str]) -> str:
    """Return ``; did you mean 'x'?`` for the known word nearest to `word`; empty if none is near."""
    from difflib import get_close_matches  # noqa: PLC0415 - most labs have no misspelling

    matches = get_close_matches(word, known, n=1, cutoff=0.6)
    return f"; did you mean '{matches[0]}'?" if matches else ""
