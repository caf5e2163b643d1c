"""Settings of all tests."""

from hypothesis import settings

settings.register_profile("shared-machine")
settings.load_profile("shared-machine")
