import numpy as np

from dfdbench.blur.law import BlurLaw, law_of_fields
from dfdbench.methods.measured_law import Calibration


def test_laws_of_a_stack_come_back_with_and_without_a_fall_off() -> None:
    law = BlurLaw((1.0, 0.5), similarity=(0.1, 0, 0, 0.01), falloff=((1.0,) * 8 + (0.8,),) * 3)
    assert law_of_fields(law.as_dict()) == law
    pixels, left = np.array([3, 4]), np.array([0.1, 0.2])
    each = [Calibration(one, left * 9, pixels, left) for one in (law, BlurLaw((1.0, 0.5)))]
    found = Calibration.all_of(Calibration.all_as_learned(each))
    assert [one.law for one in found] == [law, BlurLaw((1.0, 0.5))]
    for name in ("measured", "pixels", "residual"):
        assert np.array_equal(getattr(found[0], name), getattr(each[0], name))
