"""Where readings go: a queue that never waits, and a sender for each way out."""

from glint_aoa.live.outputs.queued import Output, Sender
from glint_aoa.live.outputs.stream import LineSender
from glint_aoa.live.outputs.udp import UdpSender

__all__ = ["LineSender", "Output", "Sender", "UdpSender"]
