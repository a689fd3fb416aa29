"""Many points at once: on the processors of this machine, or on a Dask cluster."""

from glint_aoa.batch.run import BatchResult, process_batch
from glint_aoa.batch.sizing import Sizing
from glint_aoa.batch.store import open_store
from glint_aoa.batch.survey import points_in

__all__ = ["BatchResult", "Sizing", "open_store", "points_in", "process_batch"]
