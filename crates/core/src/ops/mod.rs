//! The operations on tensors, one file each.
//!
//! | file | operations |
//! |---|---|
//! | `add`, `sub`, `mul`, `div`, `minimum`, `maximum` | pairs of entries, with broadcasting |
//! | `affine` | `a x + b` with constants: `-x`, `x + 1`, `2 * x` |
//! | `exp`, `ln`, `sqrt`, `powi`, `tanh`, `sigmoid`, `softplus`, `abs`, `clamp` | each entry |

mod abs;
mod add;
mod affine;
mod clamp;
mod div;
mod exp;
mod ln;
mod maximum;
mod minimum;
mod mul;
mod powi;
mod sigmoid;
mod softplus;
mod sqrt;
mod sub;
mod tanh;
