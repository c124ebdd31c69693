"""Arrays of files that somebody handed in, and what reading damaged ones comes to."""

import struct
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL.Image import DecompressionBombError

from dfdbench.system.files import require_file

#: Of ``numpy.load``, which parses heads as Python and archives as zip files, and of Pillow.
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
#: Of an image, besides: one that claims more pixels than anybody has.
UNREADABLE_IMAGE: tuple[type[Exception], ...] = (*UNREADABLE, DecompressionBombError)


def load_array(path: Path) -> NDArray[Any]:
    """Return the array of an ``.npy`` file, mapped into memory and without pickle.

    Mapped, so that a header that claims more than the file holds takes no memory.

    Raises
    ------
    ValueError, and others of `UNREADABLE`
        Where it is none; an archive under that name, too.

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
