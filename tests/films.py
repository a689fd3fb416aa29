"""Films of a bright line that moves, and videos of them written by PyAV."""

from fractions import Fraction

import av
import numpy as np

SCANS = ("progressive", "even first", "odd first")


def film(n_frames, shape=(48, 60), *, row, scan="progressive", noise=1.0, seed=0):
    """Film a line; `row` gives its frame line at a time in frames. uint8 [frame, line, column]."""
    lines, columns = shape
    rng = np.random.default_rng(seed)
    line = np.arange(lines)[:, None]
    late = {"progressive": (0.0, 0.0), "even first": (0.0, 0.5), "odd first": (0.5, 0.0)}[scan]
    frames = (
        rng.normal(20.0, noise, (n_frames, lines, columns))
        if noise
        else 20.0 + np.zeros((n_frames, lines, columns))
    )
    for number in range(n_frames):
        for parity in (0, 1):
            at = row(number + late[parity]) + 0.02 * np.arange(columns)
            glint = 150 * np.exp(-0.5 * ((line - at) / 3.0) ** 2)
            frames[number, parity::2] += glint[parity::2]
    return np.clip(np.rint(frames), 0, 255).astype(np.uint8)


def vibration(hertz, amplitude, *, rate=30.0, middle=24.0, phase=0.3):
    """Return the row of a vibrating line at a time in frames."""
    return lambda time: middle + amplitude * np.sin(2 * np.pi * hertz * time / rate + phase)


def write_video(
    path,
    frames,
    *,
    codec="ffv1",
    layout="gray",
    rate=30,
    numbers=None,
    tick=None,
    given=None,
    **options,
):
    """Write frames, which are in the format `given` (or `layout`), at presentation `numbers`."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate, options=options)
        stream.height, stream.width = frames.shape[1:3]
        if layout.startswith("yuv"):  # luma and chroma one above the other
            stream.height = frames.shape[1] * 2 // 3
        stream.pix_fmt = layout
        if tick is not None:
            stream.time_base = stream.codec_context.time_base = Fraction(tick)
        for number, pixels in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(pixels, format=given or layout)
            frame.pts = number if numbers is None else numbers[number]
            if tick is not None:
                frame.time_base = Fraction(tick)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def fields_of(frames, scan):
    """Split frames into fields in the order of time, independently of the reader."""
    if scan == "progressive":
        return frames
    even, odd = frames[:, 0::2], frames[:, 1::2]
    pair = (even, odd) if scan == "even first" else (odd, even)
    return np.stack(pair, axis=1).reshape(-1, *even.shape[1:])
