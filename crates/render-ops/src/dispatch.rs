//! Which vectors work is compiled for.
//!
//! `pulp::Arch` takes the widest vectors that the processor has. Each width is one more copy of the work to
//! compile. Where faces have few pixels, and where texels are looked up, the widest one is no faster:
//! `lab/docs/performance.md` has the figures. Numbers that are not the machine's own, such as dual
//! ones, have no vectors to gain from: their work is compiled once.
//!
//! Work can be a closure, marked to be inlined, that moves what it changes. One that could run twice is called by value
//! through a function of the compiler's own, which is compiled for no vectors.

use bokashi_core::Scalar;
use pulp::{Simd, WithSimd};

/// Runs `work` on numbers `T` with the widest vectors that the processor has.
#[inline(always)]
pub(crate) fn dispatch<T: Scalar, W: WithSimd>(work: W) -> W::Output {
    if T::HAS_VECTORS {
        pulp::Arch::new().dispatch(work)
    } else {
        Simd::vectorize(pulp::Scalar, work)
    }
}

/// Runs `work` on numbers `T` with vectors of up to 256 bits.
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
#[inline(always)]
pub(crate) fn dispatch_256<T: Scalar, W: WithSimd>(work: W) -> W::Output {
    if T::HAS_VECTORS
        && let Some(simd) = pulp::x86::V3::try_new()
    {
        Simd::vectorize(simd, work)
    } else {
        Simd::vectorize(pulp::Scalar, work)
    }
}

/// Runs `work` on numbers `T` with the processor's vectors: none is wider than 256 bits.
#[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
#[inline(always)]
pub(crate) fn dispatch_256<T: Scalar, W: WithSimd>(work: W) -> W::Output {
    dispatch::<T, W>(work)
}

/// Runs `special` on `work` with vectors of up to 256 bits. Where the processor has none of numbers `T`, it runs
/// `general`, which gives the same numbers: one form is compiled there, and not each of the special ones.
#[inline(always)]
pub(crate) fn dispatch_special<T: Scalar, A, O>(
    work: A,
    mut special: impl FnMut(A) -> O,
    general: impl FnOnce(A) -> O,
) -> O {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    let simd = pulp::x86::V3::try_new();
    #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
    let simd = Some(pulp::Arch::new());
    if T::HAS_VECTORS
        && let Some(simd) = simd
    {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        return Simd::vectorize(
            simd,
            #[inline(always)]
            || special(work),
        );
        #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
        return simd.dispatch(
            #[inline(always)]
            || special(work),
        );
    }
    general(work)
}
