from pathlib import Path

import numpy as np
import pytest

from dfdbench.errors import MethodError, UnknownNameError
from dfdbench.methods.registry import load_method

IMAGE = np.zeros((4, 6, 3), np.uint8)


def test_a_file_and_a_module_give_the_same_method(module: Path) -> None:
    for name in (f"{module}:predict", "mine.py:predict", "mine:predict"):
        method = load_method(name, {}, {})
        assert method.predict(IMAGE, IMAGE).tolist() == [[7] * 6] * 4
        assert method.source_sha256 is not None


def test_what_cannot_be_imported_says_why(module: Path) -> None:
    module.with_name("broken.py").write_text("def predict(:\n")
    module.with_name("needs.py").write_text("import nosuchpackage\n")
    for name, told in (
        ("nosuch:thing", "no module named nosuch"),
        ("nosuch.py:thing", "no such file"),
        ("mine.py:predikt", "did you mean predict"),
        ("mine.py:number", "not a method"),
        ("broken:predict", "SyntaxError: invalid syntax (broken.py, line 1)"),
        ("needs.py:predict", "No module named 'nosuchpackage' (needs.py:1 in <module>)"),
        # A dot for a colon: told with what was meant.
        ("mine.Named", "did you mean mine:Named?"),
        ("mine", "did you mean mine:predict?"),
        ("mine.py", "did you mean mine.py:predict?"),
        ("broken.predict", "file.py:function, module:function or model.onnx"),
    ):
        with pytest.raises(MethodError if ":" in name else UnknownNameError) as caught:
            load_method(name, {}, {})
        assert told in str(caught.value)
        assert "importlib" not in str(caught.value)
