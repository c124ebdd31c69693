import numpy as np

from dfdbench.blur.law import BlurLaw, law_of_fields
from dfdbench.methods.measured_law import Calibration


def test_laws_of_a_stack_come_back_with_and_without_a_fall_off() -> None:
    law = BlurLaw((1.0, 0.5), similarity=(0.1, 0, 0, 0.01), falloff=((1.0, -0.2, 0.0),) * 3)
    assert law_of_fields(law.as_dict()) == law
    ones = np.ones(2)
    each = [
        Calibration(one, ones, np.ones(2, np.int64), ones) for one in (law, BlurLaw((1.0, 0.5)))
    ]
    found = Calibration.all_of(Calibration.all_as_learned(each))
    assert [one.law for one in found] == [law, BlurLaw((1.0, 0.5))]
