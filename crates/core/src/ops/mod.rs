//! The operations on tensors, one file each.
//!
//! | file | operations |
//! |---|---|
//! | `add`, `sub`, `mul`, `div`, `minimum`, `maximum` | pairs of entries, with broadcasting |
//! | `affine` | `a x + b` with constants: `-x`, `x + 1`, `2 * x` |
//! | `exp`, `ln`, `sqrt`, `powi`, `sin`, `cos`, `tanh`, `sigmoid`, `softplus`, `abs`, `clamp` | each entry |
//! | `sum`, `mean` | of all entries, or along an axis |
//! | `matmul` | product of two matrices |
//! | `reshape`, `permute` | the same entries under another shape; `transpose` of a matrix |
//! | `slice`, `gather_rows` | part of an axis; rows by index |
//! | `squared_error` | its sum or mean over all entries |
//! | `concat` | arrays one after another along an axis |

mod abs;
mod add;
mod affine;
mod clamp;
mod concat;
mod cos;
mod div;
mod exp;
mod gather_rows;
mod ln;
mod matmul;
mod maximum;
mod mean;
mod minimum;
mod mul;
mod permute;
mod powi;
mod reshape;
mod sigmoid;
mod sin;
mod slice;
mod softplus;
mod sqrt;
mod squared_error;
mod sub;
mod sum;
mod tanh;

pub use squared_error::{mean_squared_error, squared_error};
