"""Numbers in sentences."""


def counted(number: int, what: str) -> str:
    """For example ``1 road`` and ``2 roads``."""
    return f"{number} {what}{'' if number == 1 else 's'}"
