"""What a renderer's process may do instead of drawing; stands in a module that it can import."""

import os
import signal


def crash(name, answer):
    """Die as a broken graphics driver makes a process die."""
    os.kill(os.getpid(), signal.SIGKILL)


def leave(name, answer):
    """End without a word."""
    os._exit(3)


def be_idle(name, answer):
    """Never answer."""
    signal.pause()
