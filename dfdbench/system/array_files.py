"""Read array files from users, and list the errors that damaged ones raise."""

import io
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray
from PIL.Image import DecompressionBombError

from dfdbench.system.files import LARGEST_ARRAY, require_file

#: Raised by ``numpy.load``, which parses headers as Python and archives as zip files, and by
#: Pillow.
UNREADABLE: tuple[type[Exception], ...] = (
    ArithmeticError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
#: Raised for images; one may claim more pixels than any real image has.
UNREADABLE_IMAGE: tuple[type[Exception], ...] = (*UNREADABLE, DecompressionBombError)


def load_array(path: Path) -> NDArray[Any]:
    """Return the array of an ``.npy`` file, mapped into memory and without pickle.

    Mapping it means that a header that claims more than the file holds takes no memory.

    Raises
    ------
    ValueError, and others of `UNREADABLE`
        If it is not such a file; this includes archives under that name.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.save(Path(folder) / "a.npy", np.arange(3))
    ...     load_array(Path(folder) / "a.npy").tolist()
    [0, 1, 2]
    """
    require_file(path)
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if not isinstance(array, np.ndarray):
        array.close()
        raise ValueError("an archive, and not an array")
    return array


def load_arrays(file: Path | io.BytesIO) -> NpzFile:
    """Open an ``.npz`` file without pickle, if its arrays take less than a GiB each once unpacked.

    Raises
    ------
    ValueError, and others of `UNREADABLE`
        If it is not such a file.
    """
    arrays = np.load(file, allow_pickle=False)
    if not isinstance(arrays, NpzFile):
        raise ValueError("an array, and not an archive")
    if arrays.zip and any(part.file_size > LARGEST_ARRAY for part in arrays.zip.infolist()):
        arrays.close()
        raise ValueError("unpacked it is larger than any depth map")
    return arrays
