"""What is asked of every HDF5 dataset first: that its data are in the file, and all of them.

Serves recorded points and MATLAB files of version 7.3.
"""

import math
from pathlib import Path

import h5py

from glint_aoa.errors import RecordingError
from glint_aoa.records.fields import MAX_FIELD_BYTES

__all__ = ["check_inside", "check_storage"]


def check_inside(path: Path, dataset: h5py.Dataset) -> None:
    """Refuse a dataset that keeps its data in other files."""
    plist = dataset.id.get_create_plist()
    if plist.get_layout() == h5py.h5d.VIRTUAL or plist.get_external_count():
        raise RecordingError(
            f"{path}: {dataset.name} keeps its data in other files, which are not followed; "
            "store the data in the file itself"
        )


def check_storage(path: Path, dataset: h5py.Dataset) -> None:
    """Hold a dataset's shape against what the file stores for it, before anything is allocated."""
    chunks = dataset.chunks
    n_bytes = math.prod(dataset.shape) * dataset.dtype.itemsize
    if chunks is None:
        is_whole = dataset.id.get_storage_size() >= n_bytes
    else:
        n_chunks = math.prod(
            math.ceil(n / chunk) for n, chunk in zip(dataset.shape, chunks, strict=True)
        )
        is_whole = dataset.id.get_num_chunks() >= n_chunks
        if math.prod(chunks) * dataset.dtype.itemsize > 2 * MAX_FIELD_BYTES:
            raise RecordingError(
                f"{path}: {dataset.name} is stored in chunks of {list(chunks)}, too large to read "
                "piece by piece; store it chunked by field"
            )
    if not is_whole:
        raise RecordingError(
            f"{path}: {dataset.name} promises {list(dataset.shape)} of {dataset.dtype}, but the "
            "file stores less; it is cut short, record or copy it again"
        )
