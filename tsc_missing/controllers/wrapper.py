"""A controller around another one."""

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.recent import reported
from tsc_missing.network.model import FloatArray
from tsc_missing.sensing.observation import VEHICLES, Observation


class Wrapper(Controller):
    """Has a controller decide, and may overrule it; estimates and plans are the controller's."""

    def __init__(self, controller: Controller) -> None:
        """``controller`` is asked at every step."""
        self.controller = controller

    def reset(self, context: ControlContext) -> None:
        """Reset the controller."""
        self.controller.reset(context)

    def estimates(self) -> FloatArray | None:
        """(N, 12, F): the controller's."""
        return self.controller.estimates()

    def plans(self) -> FloatArray | None:
        """(N, H, 12, F): the controller's."""
        return self.controller.plans()

    def believed_vehicles(self, observation: Observation) -> FloatArray:
        """(N, 12): what was seen, else what the last decision was based on, else NaN.

        Estimates of an own controller that cannot be had are none; ``Safe`` says why.
        """
        seen = observation.values[:, :, VEHICLES]
        try:
            estimates = self.estimates()
        except Exception:
            estimates = None
        guess = np.full_like(seen, np.nan) if estimates is None else estimates[:, :, VEHICLES]
        return np.asarray(np.where(reported(observation), seen, guess))
