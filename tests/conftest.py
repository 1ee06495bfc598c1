"""What every test shares."""

import os

from hypothesis import settings

# Draw without a display; has to be set before pyrender is first imported.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

settings.register_profile("quick", max_examples=50, derandomize=True, deadline=None)
settings.register_profile("full", max_examples=1000, deadline=None)
settings.load_profile("quick")  # `make test-all` asks for "full"
