"""Formats by family: whole files to start from, written by the formats' own libraries."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import h5py
import numpy as np
import pyuff
import scipy.io
import tifffile
from nptdms import ChannelObject, TdmsWriter

from fuzz.cine_files import write_cine
from glint_aoa.records.conditioning import prepared
from glint_aoa.records.formats import open_acquisition, open_fields

__all__ = ["FAMILIES", "Family", "read_channels", "read_fields"]

_RNG = np.random.default_rng(7)
_FIELDS = _RNG.integers(0, 256, (6, 10, 14), dtype=np.uint8)
_TIME = np.arange(64) / 800
_WAVE = np.sin(2 * np.pi * 9.8 * _TIME)
_MOST_READ = 64  # fields at each end


@dataclass(frozen=True)
class Family:
    """Files that one reader opens.

    Attributes
    ----------
    seeds : callable
        Writes whole recordings to a folder, each a list of files that belong together; the last
        is the one to open.
    read : callable
        Opens and reads a file.
    """

    seeds: Callable[[Path], Sequence[Sequence[Path]]]
    read: Callable[[Path], object]


def read_fields(path: Path) -> None:
    """Read the first and the last fields of a recording, block by block."""
    stack = open_fields(path)
    count = stack.n_fields
    for first in (*range(0, min(count, _MOST_READ), 8), max(0, count - 8)):
        stack.read(first, min(first + 8, count))


def read_channels(path: Path) -> None:
    """Read a record's channels as a correction would."""
    prepared(open_acquisition(path))


def _read_point(path: Path) -> None:
    problems = []
    for read in (read_fields, read_channels):
        try:
            read(path)
        except Exception as error:  # each has its turn
            problems.append(error)
    if problems:
        raise problems[-1]


def _hdf5(folder: Path) -> list[list[Path]]:
    paths = []
    for name, options in (("plain", {}), ("packed", {"compression": "gzip", "shuffle": True})):
        path = folder / f"{name}.h5"
        with h5py.File(path, "w") as file:
            fields = file.create_dataset("fields", data=_FIELDS, chunks=(1, 10, 14), **options)
            said = {"rate_hz": 60.0, "exposure_s": 1e-3, "first_line": 98, "first_parity": "even"}
            fields.attrs.update({**said, "interlaced": True, "trigger_time": "2026-01-12T08:00:00"})
            file["fields_time"] = np.arange(6) / 60
            file.create_group("meta").attrs.update({"run": "7", "nominal_angle_deg": 4.3})
            for channel in ("ay_face", "aoa_filtered"):
                samples = file.create_dataset(f"das/{channel}", data=(9e3 * _WAVE).astype("<i2"))
                samples.attrs.update({"rate_hz": 800.0, "start_s": 0.0, "scale": 1e-3})
                samples.attrs.update({"quantity": "acceleration", "units": "m/s^2", "axis": "+y"})
        paths.append([path])
    return paths


def _numpy(folder: Path) -> list[list[Path]]:
    np.save(folder / "plain.npy", _FIELDS)
    np.save(folder / "deep.npy", np.asfortranarray(_FIELDS.astype(np.uint16)))
    np.savez(folder / "plain.npz", fields=_FIELDS, rate_hz=60.0)
    np.savez_compressed(folder / "packed.npz", fields=_FIELDS, first_parity="odd")
    return [[folder / name] for name in ("plain.npy", "deep.npy", "plain.npz", "packed.npz")]


def _tiff(folder: Path) -> list[list[Path]]:
    deep = _FIELDS.astype(np.uint16) * 16
    tifffile.imwrite(folder / "plain.tif", _FIELDS, photometric="minisblack")
    tifffile.imwrite(folder / "packed.tif", deep, photometric="minisblack", compression="zlib")
    tifffile.imwrite(folder / "imagej.tif", deep, imagej=True)
    tifffile.imwrite(folder / "big.tif", _FIELDS, bigtiff=True, byteorder=">")
    return [[folder / f"{name}.tif"] for name in ("plain", "packed", "imagej", "big")]


_CIH = """#Camera Information Header
Date : 2024/05/31
Record Rate(fps) : 15000
Shutter Speed(s) : 1/20000
Total Frame : 6
Start Frame : -3
Save Step : 100
Image Width : 14
Image Height : 10
Color Type : Mono
Color Bit : {bits}
EffectiveBit Depth : {bits}
EffectiveBit Side : Lower

END
"""


def _photron(folder: Path) -> list[list[Path]]:
    deep = _FIELDS.astype("<u2") * 16
    pairs = deep.reshape(-1, 2)
    twelve = np.stack(
        [pairs[:, 0] >> 4, (pairs[:, 0] & 15) << 4 | pairs[:, 1] >> 8, pairs[:, 1] & 255], axis=1
    )
    packed = twelve.astype(np.uint8).tobytes()
    recordings = []
    for bits, content in ((8, _FIELDS.tobytes()), (12, packed), (16, deep.tobytes())):
        header, pixels = folder / f"bits{bits}.cih", folder / f"bits{bits}.mraw"
        header.write_text(_CIH.format(bits=bits))
        pixels.write_bytes(content)
        recordings.append([pixels, header])
    return recordings


def _csv(folder: Path) -> list[list[Path]]:
    rows = [f"{t:.6f},{x:.6f},{-x:.4e}" for t, x in zip(_TIME, _WAVE, strict=True)]
    (folder / "plain.csv").write_text("\n".join(["time_s,ay_face [m/s^2],aoa [g]", *rows, ""]))
    tabs = "\n".join(["Time [s]\tay (g)", *(row.rpartition(",")[0] for row in rows)])
    (folder / "tabs.txt").write_text(tabs.replace(",", "\t").replace(".", ","))
    return [[folder / "plain.csv"], [folder / "tabs.txt"]]


def _tdms(folder: Path) -> list[list[Path]]:
    clock = {"wf_increment": 1 / 800, "wf_start_offset": 0.0, "wf_samples": _TIME.size}
    for name, samples in (("whole", _WAVE), ("counts", (9e3 * _WAVE).astype(np.int16))):
        with TdmsWriter(folder / f"{name}.tdms") as file:
            for part in np.array_split(samples, 2):
                file.write_segment(
                    [ChannelObject("das", "ay", part, {**clock, "unit_string": "g"})]
                )
    return [[folder / "whole.tdms"], [folder / "counts.tdms"]]


def _uff(folder: Path) -> list[list[Path]]:
    common = {
        "type": 58, "func_type": 1, "func_id": 0, "ver_num": 0, "load_case_id": 0, "rsp_node": 1,
        "rsp_dir": 2, "ref_ent_name": "NONE", "ref_node": 0, "ref_dir": 0, "id1": "NONE",
        "id2": "NONE", "id3": "NONE", "id4": "NONE", "id5": "NONE", "z_axis_value": 0,
        "abscissa_spec_data_type": 17, "ordinate_spec_data_type": 12, "orddenom_spec_data_type": 0,
        "z_axis_spec_data_type": 0, "rsp_ent_name": "ay_face", "data": _WAVE, "x": _TIME,
        "abscissa_spacing": 1, "abscissa_min": 0.0, "abscissa_inc": 1 / 800,
        "num_pts": _TIME.size, "ordinate_axis_units_lab": "m/s^2",
    }  # fmt: skip
    for name, binary in (("text", 0), ("binary", 1)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)  # pyuff leaves files open
            file = pyuff.UFF(str(folder / f"{name}.uff"))
            file.write_sets([{**common, "binary": binary}] * 2, "add")
    return [[folder / "text.uff"], [folder / "binary.uff"]]


def _matlab(folder: Path) -> list[list[Path]]:
    plain = {"ay_face": _WAVE, "time": _TIME}
    scipy.io.savemat(folder / "plain.mat", plain)
    scipy.io.savemat(folder / "packed.mat", {**plain, "note": "a"}, do_compression=True)
    with h5py.File(folder / "new.mat", "w", userblock_size=512) as file:
        for name, values in (("ay_face", _WAVE), ("time", _TIME)):
            file[name] = values[:, None]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with (folder / "new.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64 HDF5 schema".ljust(512, b"\0"))
    return [[folder / f"{name}.mat"] for name in ("plain", "packed", "new")]


def _video(folder: Path) -> list[list[Path]]:
    grey = np.repeat(np.repeat(_FIELDS, 4, axis=1), 4, axis=2)
    colour = np.concatenate([grey, grey[:, :20] // 2 + 64], axis=1)
    kinds = (
        ("whole.avi", "ffv1", "gray", grey),
        ("whole.mkv", "ffv1", "gray", grey),
        ("lossy.mp4", "mpeg4", "yuv420p", colour),
    )
    for name, codec, layout, frames in kinds:
        with av.open(str(folder / name), "w") as container:
            stream = container.add_stream(codec, rate=30)
            stream.width, stream.height, stream.pix_fmt = grey.shape[2], grey.shape[1], layout
            for pixels in frames:
                frame = av.VideoFrame.from_ndarray(pixels, format=layout)
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
    return [[folder / name] for name, *_ in kinds]


def _cine(folder: Path) -> list[list[Path]]:
    deep = _FIELDS.astype(np.uint16) * 4
    levels = {"8": (_FIELDS, 0), "16": (deep, 0), "packed": (np.repeat(deep, 2, axis=2), 256)}
    for name, (images, packing) in levels.items():
        write_cine(folder / f"{name}.cine", images, packing=packing)
    return [[folder / f"{name}.cine"] for name in levels]


def _pictures(folder: Path) -> list[list[Path]]:
    (folder / "pictures").mkdir()
    paths = [folder / "pictures" / f"p{number}.png" for number in range(3)]
    for path, pixels in zip(paths, _FIELDS, strict=False):
        cv2.imwrite(str(path), pixels)
    return [[*paths]]


def _read_folder(path: Path) -> None:
    read_fields(path.parent)


FAMILIES = {
    "hdf5": Family(_hdf5, _read_point),
    "numpy": Family(_numpy, read_fields),
    "tiff": Family(_tiff, read_fields),
    "photron": Family(_photron, read_fields),
    "cine": Family(_cine, read_fields),
    "video": Family(_video, read_fields),
    "pictures": Family(_pictures, _read_folder),
    "csv": Family(_csv, read_channels),
    "tdms": Family(_tdms, read_channels),
    "uff": Family(_uff, read_channels),
    "matlab": Family(_matlab, read_channels),
}
