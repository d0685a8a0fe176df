"""Makes the files in arrays/, which the tests of crates/scene/src/arrays read.

Made with Python 3.11.7, NumPy 2.4.6 and safetensors 0.8.0:

    python3 -m venv env && env/bin/pip install numpy==2.4.6 safetensors==0.8.0
    env/bin/python make_arrays.py

Where a file's name does not say otherwise, entry k in row-major order is k - 2.
"""

from pathlib import Path

import numpy as np
from numpy.lib import format as npy
from safetensors.numpy import save_file

HERE = Path(__file__).parent / "arrays"
HERE.mkdir(exist_ok=True)


def counted(dtype, shape):
    size = int(np.prod(shape, dtype=np.int64))
    return (np.arange(size) - 2).reshape(shape).astype(dtype)


# As numpy.save has them: these come back byte for byte.
plain = {
    "f4": counted("<f4", (2, 3)),
    "f8": counted("<f8", (2, 3)),
    "f2": counted("<f2", (2, 3)),
    "i1": counted("i1", (7,)),
    "i2": counted("<i2", (7,)),
    "i4": counted("<i4", (7,)),
    "i8": counted("<i8", (7,)),
    "scalar": np.array(-2.0),
    "one_axis": counted("<f4", (11,)),
    "five_axes": counted("<f8", (2, 1, 3, 1, 2)),
    "no_rows": counted("<f4", (0, 3)),
    "no_columns": counted("<f8", (3, 0, 2)),
    "long": np.zeros((12345678901, 0), "<f4"),
    "many_axes": counted("<f4", (1,) * 31 + (2,)),
    # Its header would end at a multiple of 64, and NumPy adds 64 spaces.
    "aligned": np.zeros((1,) * 35 + (0,), "<f4"),
    # One letter before that.
    "nearly_aligned": np.zeros((1,) * 12 + (10, 0), "<f4"),
    # The largest and the smallest of each type.
    "extreme_u1": np.array([0, 255], "u1"),
    "extreme_u2": np.array([0, 2**16 - 1], "<u2"),
    "extreme_u4": np.array([0, 2**32 - 1], "<u4"),
    "extreme_u8": np.array([0, 2**64 - 1], "<u8"),
    "extreme_i1": np.array([-(2**7), 2**7 - 1], "i1"),
    "extreme_i2": np.array([-(2**15), 2**15 - 1], "<i2"),
    "extreme_i4": np.array([-(2**31), 2**31 - 1], "<i4"),
    "extreme_i8": np.array([-(2**63), 2**63 - 1], "<i8"),
    "truth": np.array([[True, False], [False, True]]),
    # Bits: 0, -0, the least denormal, infinity, -infinity, and NaNs with a sign and digits.
    "bits_f2": np.array([0, 0x8000, 1, 0x7C00, 0xFC00, 0x7E01, 0xFC01], "<u2").view("<f2"),
    "bits_f4": np.array(
        [0, 1 << 31, 1, 0x7F80_0000, 0xFF80_0000, 0x7FC0_0001, 0xFF80_0001], "<u4"
    ).view("<f4"),
    "bits_f8": np.array(
        [0, 1 << 63, 1, 0x7FF << 52, 0xFFF << 52, (0x7FF8 << 48) + 1, (0xFFF << 52) + 1], "<u8"
    ).view("<f8"),
}
for name, array in plain.items():
    np.save(HERE / f"{name}.npy", array)

# Other orders of bytes and of axes.
other = {
    "big_f2": counted(">f2", (2, 3)),
    "big_f4": counted(">f4", (2, 3)),
    "big_f8": counted(">f8", (2, 3)),
    "big_i2": counted(">i2", (2, 3)),
    "big_u4": np.arange(6, dtype=">u4").reshape(2, 3) + np.uint32(1),
    "fortran_f8": np.asfortranarray(counted("<f8", (2, 3))),
    "fortran_four_axes": np.asfortranarray(counted("<f4", (2, 3, 4, 5))),
    "fortran_big_i8": np.asfortranarray(counted(">i8", (3, 2, 2))),
    "fortran_truth": np.asfortranarray(np.array([[True, True, False], [False, True, False]])),
}
for name, array in other.items():
    np.save(HERE / f"{name}.npy", array)
for version in [(2, 0), (3, 0)]:
    with open(HERE / f"version_{version[0]}.npy", "wb") as file:
        npy.write_array(file, counted("<f8", (2, 3)), version=version)

# What is no array of numbers.
foreign = {
    "objects": np.array([{"a": 1}, None], dtype=object),
    "records": np.zeros(2, [("a[]'", "<f4"), ("b", "<i4", (2,))]),
    "records_3": np.zeros(2, [("\u6c5f", "<f4")]),
    "complex": np.zeros(2, "<c16"),
    "texts": np.array(["a", "bc"]),
    "byte_texts": np.array([b"a", b"bc"]),
    "times": np.array(["2020-01-01"], "datetime64[D]"),
    "long_double": np.zeros(2, np.longdouble),
    "raw": np.zeros(2, "V3"),
}
for name, array in foreign.items():
    np.save(HERE / f"{name}.npy", array, allow_pickle=True)

several = {
    "vertices": counted("<f4", (4, 3)),
    "faces": np.array([[0, 1, 2], [2, 1, 3]]),
    "a/weights": np.asfortranarray(counted("<f8", (2, 2))),
    "names": np.array(["one", "two"]),
    "\u6c5f": np.array(7.0),
}
np.savez(HERE / "several.npz", **several)
np.savez_compressed(HERE / "compressed.npz", **several)
np.savez(HERE / "none.npz")

save_file(
    {
        "vertices": counted("<f4", (4, 3)),
        "faces": np.array([[0, 1, 2], [2, 1, 3]]),
        "a.weights": counted("<f8", (2, 2)),
        "half": counted("<f2", (3,)),
        "bytes": np.array([0, 255], "u1"),
        "truth": np.array([True, False]),
        "none": counted("<f4", (0, 3)),
        "scalar": np.array(-2.0),
    },
    HERE / "several.safetensors",
    metadata={"made by": "NumPy"},
)
