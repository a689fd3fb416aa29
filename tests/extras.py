"""What tests of optional parts need, and when they may do without: never where CI runs them."""

import importlib.util
import os
import shutil

import pytest


def needs(*modules, programs=()):
    """Skip the module or test that calls this where something is missing; in CI, fail."""
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    missing += [name for name in programs if shutil.which(name) is None]
    if not missing:
        return
    reason = f"{', '.join(missing)} not installed"
    if os.environ.get("GLINT_AOA_CI"):
        raise RuntimeError(f"{reason}, but GLINT_AOA_CI says that nothing may be skipped")
    pytest.skip(reason, allow_module_level=True)
