"""The recorded data beside the checkout, and the mark for tests that need it."""

from pathlib import Path

import pytest

CITYFLOW = Path(__file__).resolve().parents[2] / "shared" / "data" / "cityflow"

needs_shared = pytest.mark.skipif(
    not CITYFLOW.is_dir(), reason="the recorded data is not there (../shared/data/cityflow)"
)
