"""A suite that takes a network's sensors away one after the other: which is missed most?"""

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from tsc_missing.batch.suite import slug
from tsc_missing.files import whole_folder
from tsc_missing.network.model import Network
from tsc_missing.network.slots import APPROACHES, TURNS
from tsc_missing.sensing.outage_list import COLUMNS

FIELD = "--out"
SUITE = "suite.toml"
NOTHING = "none"  # the case of the runs that the others are held against
LONGEST = 80  # characters of an id in a file's name


def write_outage_suite(
    network: Network, out: Path, approaches: bool, block: Mapping[str, object]
) -> tuple[str, ...]:
    """Write a list of outages for each intersection, and the suite that runs them; their names.

    With ``approaches`` for each approach of each intersection. ``block`` has the keys of the
    suite's runs beside what is missing: method, net, seed and whatever else. Raises ``UserError``
    unless ``out`` can be made.
    """
    lists = dict(_outages(network, approaches))
    with whole_folder(out, FIELD) as folder:
        for name, row in lists.items():
            with (folder / name).open("w", encoding="utf-8", newline="") as stream:
                csv.writer(stream, lineterminator="\n").writerows([COLUMNS[:2], row])
        text = _suite(network.name, block, tuple(lists))
        (folder / SUITE).write_text(text, encoding="utf-8")
    return tuple(lists)


def _outages(network: Network, approaches: bool) -> Iterator[tuple[str, tuple[str, str]]]:
    """The name of each file and its row."""
    taken = {NOTHING}
    for n, identity in enumerate(network.ids):
        there = network.slot_mask[n].reshape(-1, len(TURNS)).any(axis=1)
        names = [a for a, one in zip(APPROACHES, there, strict=True) if one] if approaches else [""]
        for approach in names:
            short = slug(identity)[:LONGEST]
            plain = "-".join(filter(None, (short, approach)))
            if short == identity and plain.lower() not in taken:
                name = plain
            else:  # several ids may come to the same
                name = "-".join(filter(None, (short, str(n), approach)))
            taken.add(name.lower())
            yield f"{name}.csv", (identity, approach)


def _suite(name: str, block: Mapping[str, object], files: Sequence[str]) -> str:
    """Text in TOML, whose strings, numbers and lists of them are JSON's."""

    def text(value: object) -> str:
        return json.dumps(value, ensure_ascii=False)

    runs = "".join(f"{key} = {text(value)}\n" for key, value in block.items())
    lists = ",\n".join(f"  {text(file)}" for file in files)
    return (
        f"title = {text(f'Which sensor of {name} is missed most')}\n"
        'about = "Each case has one more outage, for the whole run, than the one with none."\n\n'
        f'[[runs]]\n{runs}missing.pattern = "none"\n\n'
        f"[[runs]]\n{runs}missing.file = [\n{lists},\n]\n"
    )
