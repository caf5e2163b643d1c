"""The one exception for a user's mistake, and the wording that every such message follows."""

import difflib
from collections.abc import Iterable
from typing import Self


class UserError(Exception):
    """Something the user can mend: printed as one line, exit status 2."""

    def __init__(
        self, field: str, value: object, allowed: str, verdict: str = "is not allowed"
    ) -> None:
        """``field`` is what was set, ``value`` what it was set to, ``allowed`` what it may be."""
        self.field = field
        self.value = value
        self.allowed = allowed
        self.verdict = verdict
        super().__init__(" ".join(f"{field}: {value} {verdict}; {allowed}".split()))

    def __reduce__(self) -> tuple[type[Self], tuple[str, object, str, str]]:
        """What it is made of, so that it comes back whole from another process."""
        return type(self), (self.field, self.value, self.allowed, self.verdict)


def nearest(value: str, known: Iterable[str]) -> str:
    """Words that name the closest of ``known`` to ``value``, in any case, and then all of them."""
    names = sorted(known)
    folded = {name.casefold(): name for name in names}
    close = difflib.get_close_matches(value.casefold(), folded, n=1, cutoff=0.5)
    hint = f"did you mean {folded[close[0]]}? " if close else ""
    return f"{hint}allowed: {', '.join(names)}"
