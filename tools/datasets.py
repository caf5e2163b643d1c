"""The six public datasets: their files in ``../shared/data/cityflow``."""

from dataclasses import dataclass
from pathlib import Path

DATA = Path("data") / "cityflow"
REFERENCE = Path("reference") / "cityflow_att.json"


@dataclass(frozen=True)
class Dataset:
    """A dataset's files and the bundled network that it belongs to."""

    name: str
    city: str
    roadnet_name: str
    flow_name: str

    def roadnet(self, shared: Path) -> Path:
        """The CityFlow road network."""
        return shared / DATA / f"{self.roadnet_name}.json"

    def flow(self, shared: Path) -> Path:
        """The CityFlow flow."""
        return shared / DATA / f"{self.flow_name}.json"


DATASETS = tuple(
    Dataset(*row)
    for row in (
        ("hangzhou_1", "hangzhou", "roadnet_4_4", "anon_4_4_hangzhou_real"),
        ("hangzhou_2", "hangzhou", "roadnet_4_4", "anon_4_4_hangzhou_real_5816"),
        ("jinan_1", "jinan", "roadnet_3_4", "anon_3_4_jinan_real"),
        ("jinan_2", "jinan", "roadnet_3_4", "anon_3_4_jinan_real_2000"),
        ("jinan_3", "jinan", "roadnet_3_4", "anon_3_4_jinan_real_2500"),
        ("newyork_1", "newyork", "roadnet_16_3", "anon_16_3_newyork_real"),
    )
)
