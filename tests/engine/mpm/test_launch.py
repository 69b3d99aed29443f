"""A kernel launched again and again sees what changed, in both precisions."""
# Without `annotations` of __future__: the compiler reads those of kernels at run time.

import numpy as np

from seeing_wind.engine.mpm.compiler import device, ti
from seeing_wind.engine.mpm.compiler.launch import Launcher

numbers = ti.types.ndarray(ndim=1)
pairs = ti.types.ndarray(element_shape=(2,), ndim=1)


def test_changed_contents_arrays_and_numbers_are_seen():
    device.start()

    @ti.kernel
    def third(doubled: ti.template(), number: ti.i32, values: numbers, out: pairs):
        for i in range(values.shape[0]):
            share = values[i] / 3.0
            if ti.static(doubled):
                share *= 2.0
            out[i] = ti.Vector([share, ti.cast(number, float)])

    for real in (np.float32, np.float64):
        launch = Launcher(third, np.dtype(real))
        values, out = np.arange(4, dtype=real), np.zeros((4, 2), real)

        def check(number, values=values, out=out, real=real, launch=launch):
            launch(True, number, values, out)
            assert np.array_equal(out[: len(values), 0], values / real(3) * real(2))  # in its own precision, to the last digit
            assert (out[: len(values), 1] == number).all()

        check(7)
        values += 1.0
        check(7)
        check(-8)
        check(9, values=np.array([5.0, 6.0, 7.0], real), out=np.zeros((3, 2), real))
        check(9, values=np.array([1.0], real))
