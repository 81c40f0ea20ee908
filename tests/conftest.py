"""What all property tests share: 60 examples where a test does not say how many, and no limit of time for one."""

from hypothesis import settings

settings.register_profile("tests", deadline=None, max_examples=60)
settings.load_profile("tests")
