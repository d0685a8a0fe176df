//! The operations on tensors, one file each.
//!
//! | file | operations |
//! |---|---|
//! | `add`, `sub`, `mul`, `div`, `pow`, `minimum`, `maximum` | pairs of entries, with broadcasting |
//! | `affine` | `a x + b` with constants: `-x`, `x + 1`, `2 * x` |
//! | `exp`, `ln`, `sqrt`, `powi`, `powf`, `sin`, `cos`, `tanh`, `sigmoid`, `softplus`, `relu`, `abs`, `clamp` | each entry |
//! | `select` | one of two entries, by a mask, with broadcasting |
//! | `sum`, `mean` | of all entries, or along an axis |
//! | `cumulative_sum` | up to each entry of an axis |
//! | `dot`, `cross`, `norm`, `normalize` | vectors along an axis |
//! | `matmul`, `sparse_product` | product of two matrices; of a constant sparse one and a variable |
//! | `reshape`, `keepdim`, `permute` | the same entries under another shape; `transpose` of a matrix |
//! | `slice`, `pad` | part of an axis; an axis that goes on |
//! | `gather_rows`, `scatter_add_rows` | rows by index |
//! | `squared_error` | its sum or mean over all entries |
//! | `concat`, `stack` | arrays one after another along an axis; along a new one |

mod abs;
mod add;
mod affine;
mod clamp;
mod concat;
mod cos;
mod cross;
mod cumulative_sum;
mod div;
mod dot;
mod exp;
mod gather_rows;
mod keepdim;
mod ln;
mod matmul;
mod maximum;
mod mean;
mod minimum;
mod mul;
mod norm;
mod normalize;
mod pad;
mod permute;
mod pow;
mod powf;
mod powi;
mod relu;
mod reshape;
mod scatter_add_rows;
mod select;
mod sigmoid;
mod sin;
mod slice;
mod softplus;
mod sparse_product;
mod sqrt;
mod squared_error;
mod stack;
mod sub;
mod sum;
mod tanh;

pub use pad::Padding;
pub use squared_error::{mean_squared_error, squared_error};
