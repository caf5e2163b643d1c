"""Every setting of a run, with its default, unit and range: the one home of configuration."""

from pathlib import PurePath
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from tsc_missing.network.records import IntersectionRecord

MIN_SPACE = 9  # [vehicles a lane] (``SignalSettings.min_space``) of DiffLight by values,
MIN_SPACE_AHEAD = 3  # and of who plans ahead on a traffic model
GUIDED_STEPS = 10  # reverse steps of a plan that rewards guide, as in the paper
BELIEF_STEPS = 3  # of what is generated as it is believed: as good as ten (docs/experiments.md),
BLIND_STEPS = 8  # but not at intersections without a sensor
AREA_LENGTH = 50.0  # [m] (``SensorSettings.length``)
MEAN_OUTAGE = 8.0  # [decision steps] (``MissingSettings.mean_outage``)
SEEDS = 2**31  # seeds of runs are below it; from it on they are of the masks of logs


class Settings(BaseModel):
    """A frozen group of settings that refuses unknown names."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class VehicleType(Settings):
    """The car of all scenarios and how it enters.

    The recorded flows name length, gap, deceleration, speed and headway; the acceleration (2 in
    the flows), the start-up delay and the lane changing were calibrated once for all datasets
    against CityFlow (``docs/experiments.md``).
    """

    length: float = Field(5.0, gt=0)  # [m]
    min_gap: float = Field(2.5, ge=0)  # [m]
    accel: float = Field(1.7, gt=0)  # [m/s2]
    decel: float = Field(4.5, gt=0)  # [m/s2]
    max_speed: float = Field(11.111, gt=0)  # [m/s]
    tau: float = Field(2.0, gt=0)  # [s], wished headway
    sigma: float = Field(0.0, ge=0, le=1)  # driver imperfection
    speed_deviation: float = Field(0.0, ge=0)
    startup_delay: float = Field(0.5, ge=0)  # [s] between being able to start and starting
    lc_keep_right: float = Field(0.0, ge=0)  # SUMO's eagerness to keep to the right lane
    lc_speed_gain: float = Field(0.0, ge=0)  # and to change lanes in order to drive faster
    depart_lane: str = "best"
    depart_speed: str = "max"
    depart_pos: str = "base"

    @property
    def spacing(self) -> float:
        """[m] of a lane that a standing vehicle takes, its gap included."""
        return self.length + self.min_gap

    def as_xml(self, name: str) -> str:
        """SUMO's ``vType`` element."""
        return (
            f'<vType id="{name}" length="{self.length:g}" minGap="{self.min_gap:g}" '
            f'accel="{self.accel:g}" decel="{self.decel:g}" maxSpeed="{self.max_speed:g}" '
            f'tau="{self.tau:g}" sigma="{self.sigma:g}" speedFactor="1" '
            f'speedDev="{self.speed_deviation:g}" startupDelay="{self.startup_delay:g}" '
            f'lcKeepRight="{self.lc_keep_right:g}" '
            f'lcSpeedGain="{self.lc_speed_gain:g}"/>'
        )


class MissingSettings(Settings):
    """Which sensors do not report, and how much (``docs/missing-patterns.md``)."""

    pattern: Literal["none", "random", "kriging", "lane", "burst", "mixed", "file"] = "none"
    rate: float = Field(0.0, ge=0, le=1)
    adjacent: bool = False  # kriging: an intersection and all its neighbours are blind
    lasting: bool = False  # lane: a slot is silent for the whole run, or never
    mean_outage: float = Field(MEAN_OUTAGE, ge=1)  # [decision steps]
    file: str = ""  # a mask.npz or a list of outages (CSV), for the pattern file

    @property
    def file_words(self) -> str:
        """What a file is called in the names of runs: ``replayed`` for the mask of a run."""
        path = PurePath(self.file)
        if path.name == "mask.npz":
            return "replayed"
        return path.name if path.stem in ("none", "replayed") else path.stem

    @property
    def variant(self) -> str:
        """What is said of a pattern beside its name; often nothing."""
        return "adjacent" if self.adjacent else "lasting" if self.lasting else ""

    @model_validator(mode="before")
    @classmethod
    def _by_file(cls, values: Any) -> Any:
        """A file says the pattern."""
        if isinstance(values, dict) and values.get("file") and "pattern" not in values:
            return {**values, "pattern": "file"}
        return values

    @model_validator(mode="after")
    def _means_something(self) -> Self:
        if self.adjacent and self.pattern != "kriging":
            raise ValueError("adjacent goes with the pattern kriging only")
        if self.lasting and self.pattern != "lane":
            raise ValueError("lasting goes with the pattern lane only")
        if self.mean_outage != MEAN_OUTAGE and self.pattern not in ("burst", "mixed"):
            raise ValueError("mean_outage goes with the patterns burst and mixed only")
        if self.rate > 0 and self.pattern == "none":
            raise ValueError("a rate above 0 needs a pattern of missing data")
        if (self.pattern == "file") != bool(self.file):
            raise ValueError("the pattern file needs a missing.file, and no other pattern has one")
        if self.pattern == "file":
            if self.rate > 0:
                raise ValueError("a rate cannot go with a file, from which nothing is drawn")
        elif self.pattern != "none" and "rate" not in self.model_fields_set:
            raise ValueError(f"the pattern {self.pattern} needs a missing.rate from 0 to 1")
        return self


class SignalSettings(Settings):
    """Timing of the signals, all in seconds."""

    decision_interval: int = Field(15, gt=0)
    yellow: int = Field(5, gt=0)  # inside the interval, when the phase changes
    all_red: int = Field(0, ge=0)  # after the yellow, inside the interval
    min_green: int = Field(10, ge=0)
    max_red: int = Field(240, ge=0)  # 0: no bound; fixed plans are left as they are
    min_space: int | None = Field(None, ge=0)  # [vehicles a lane] kept free between intersections;
    # 0: none; None: MIN_SPACE or MIN_SPACE_AHEAD by the controller, none for most
    network_timing: Literal["both", "yellow", "min_green", "none"] = "both"  # which of these two
    # an intersection takes from its network, where that has them; else those that are not given

    @model_validator(mode="before")
    @classmethod
    def _given_goes_first(cls, values: Any) -> Any:
        """What is given is not the network's; true and false are of earlier versions."""
        if not isinstance(values, dict):
            return values
        given = values.keys() & {"yellow", "min_green"}
        told = values.get("network_timing")
        if told is None and given:
            told = "none" if len(given) == 2 else ({"yellow", "min_green"} - given).pop()
        elif isinstance(told, bool):
            told = "both" if told else "none"
        return values if told is None else {**values, "network_timing": told}

    def yellow_at(self, node: IntersectionRecord) -> int:
        """The yellow of an intersection [s]."""
        own = node.yellow if self.network_timing in ("both", "yellow") else None
        return self.yellow if own is None else own

    def min_green_at(self, node: IntersectionRecord) -> int:
        """The minimum green of an intersection [s]."""
        own = node.min_green if self.network_timing in ("both", "min_green") else None
        return self.min_green if own is None else own

    def min_steps_at(self, node: IntersectionRecord) -> int:
        """The decision steps that a phase lasts at least, with what is lost before its green."""
        least = self.yellow_at(node) + self.all_red + self.min_green_at(node)
        return max(1, -(-least // self.decision_interval)) if len(node.phases) > 1 else 1

    @model_validator(mode="after")
    def _fits(self) -> Self:
        interval = self.decision_interval
        if self.all_red >= interval:
            raise ValueError(f"all_red must be shorter than a decision_interval, {interval} s")
        if self.network_timing in ("min_green", "none") and self.yellow + self.all_red >= interval:
            raise ValueError(
                f"yellow and all_red, {self.yellow} + {self.all_red} s, must be shorter than a "
                f"decision_interval, {interval} s"
            )
        return self


class SensorSettings(Settings):
    """How a lane is measured: the whole of it, or its last ``length`` metres."""

    kind: Literal["lane", "area"] = "lane"
    length: float = Field(AREA_LENGTH, ge=2)  # [m], for ``area``; who stands is seen from 2 m on

    @property
    def reach(self) -> float | None:
        """How far from the stop line a sensor sees [m]; None: all of its lane."""
        return self.length if self.kind == "area" else None

    @model_validator(mode="after")
    def _measures_something(self) -> Self:
        if self.kind != "area" and self.length != AREA_LENGTH:
            raise ValueError("length goes with the kind area only (--sensor area)")
        return self


class DiffusionSettings(Settings):
    """How the diffusion model is used, as controller or as imputer."""

    weights: str = "universal"  # a name or a path (see ``controllers.diffusion_weights``)
    sampling_steps: int | None = Field(None, ge=1)  # see ``reverse_steps``
    samples: int = Field(4, ge=1)  # of what may be where nothing is seen, for scoring "value"
    scoring: Literal["inverse", "queue", "mixed", "value", "horizon"] = (
        "horizon"  # controller difflight only (see ``controllers.difflight.Scoring``)
    )

    def reverse_steps(self, guided: bool) -> tuple[int, int]:
        """Reverse steps a decision where there are sensors, and at intersections without any."""
        default = (GUIDED_STEPS, GUIDED_STEPS) if guided else (BELIEF_STEPS, BLIND_STEPS)
        return default if self.sampling_steps is None else (self.sampling_steps,) * 2


class RunSettings(Settings):
    """One closed-loop run."""

    net: str = "jinan"
    demand: Literal["auto", "profile", "recorded"] = "auto"
    volume: float = Field(1.0, gt=0, le=10)  # times the profile's arrivals
    controller: str = "difflight"
    imputer: str = "sfm-4"
    blind: Literal[
        "auto", "none", "fixed-time", "familiar", "clustered", "alone", "expected-queue"
    ] = "auto"  # see ``controllers.registry.make_controller``
    diffusion: DiffusionSettings = DiffusionSettings()
    q_weights: str = "auto"  # of Q-networks, names or paths (see ``resolved.weights_of``)
    missing: MissingSettings = MissingSettings()
    signals: SignalSettings = SignalSettings()
    sensor: SensorSettings = SensorSettings()
    vehicle: VehicleType = VehicleType()
    turning_counts: Literal["run", "none"] = "run"  # that controllers are told
    count_error: float = Field(0.0, ge=0, le=2)  # of those of the run: the standard deviation
    # of their logarithm, drawn with the seed for each movement
    horizon: int = Field(3600, gt=0)  # [s]
    seed: int = Field(0, ge=0, lt=SEEDS)
    mask_seed: int | None = Field(None, ge=0, lt=SEEDS)  # of the mask alone; None: seed

    @model_validator(mode="after")
    def _draws_what_has_a_seed(self) -> Self:
        if self.missing.file and self.mask_seed is not None:
            raise ValueError("a mask_seed cannot go with a file, from which nothing is drawn")
        return self

    @model_validator(mode="after")
    def _errs_in_what_is_told(self) -> Self:
        if self.turning_counts == "none" and self.count_error:
            raise ValueError("a count_error cannot go with turning_counts none: nothing is told")
        return self

    @property
    def seed_of_mask(self) -> int:
        """What the mask is drawn from."""
        return self.seed if self.mask_seed is None else self.mask_seed

    @property
    def steps(self) -> int:
        """The number of decisions."""
        return -(-self.horizon // self.signals.decision_interval)
