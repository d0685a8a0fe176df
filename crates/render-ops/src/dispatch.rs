//! Work that gains nothing from vectors of 512 bits: it is compiled for 256 bits at most.
//!
//! `pulp::Arch` takes the widest vectors that the processor has. Each width is one more copy of the work to
//! compile. Where faces have few pixels, and where texels are looked up, the widest one is no faster:
//! `docs/performance.md` has the figures.

use pulp::WithSimd;
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
use pulp::{Scalar, Simd, x86::V3};

/// Runs `work` with vectors of up to 256 bits.
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
#[inline(always)]
pub(crate) fn dispatch_256<W: WithSimd>(work: W) -> W::Output {
    match V3::try_new() {
        Some(simd) => Simd::vectorize(simd, work),
        None => Simd::vectorize(Scalar, work),
    }
}

/// Runs `work` with the processor's vectors: none is wider than 256 bits.
#[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
#[inline(always)]
pub(crate) fn dispatch_256<W: WithSimd>(work: W) -> W::Output {
    pulp::Arch::new().dispatch(work)
}
