"""Property tests here are numerical: how long one example takes says nothing about it."""

from hypothesis import settings

settings.register_profile("numerical", deadline=None)
settings.load_profile("numerical")
