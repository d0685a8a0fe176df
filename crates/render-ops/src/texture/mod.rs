//! Textures: images that are looked up on surfaces.
//!
//! # Forward
//! A sample is taken at a place (u, v) of a face of `[H, W]` texels (`chart` has the way from coordinates
//! to places). Texel (i, j) has its centre at `((j + 1/2) / W, (i + 1/2) / H)`. With `x = W u - 1/2`,
//! `y = H v - 1/2` and their fractions f and g, a bilinear sample of a level is
//!
//! `B = (1 - g) ((1 - f) t_00 + f t_01) + g ((1 - f) t_10 + f t_11)`.
//!
//! With the level `lambda` (`footprint`) and its fraction r, a trilinear sample is
//! `(1 - r) B_l + r B_(l+1)`, `l = floor(lambda)`; an anisotropic sample is the mean of such probes.
//! Levels are made by `mipmaps`, or are the caller's own. A texture that is linear in the coordinates
//! comes out exactly, at any level.
//!
//! # Backward
//! `t_bar` is `s_bar` times the texel's weight (`texels`). `u_bar = W (t_01 - t_00) . s_bar`, weighted
//! alike, and `lambda_bar = (B_(l+1) - B_l) . s_bar`; from there on as in `footprint`.
//!
//! # Where it is not smooth
//! In the coordinates where they cross the middle of a texel; see also `footprint`, and `chart` for
//! cube maps. A level outside those that there are gets no gradient.
//!
//! # Source
//! Laine et al., *Modular primitives for high-performance differentiable rendering*, ACM TOG 39(6),
//! 2020, section 3.3; Williams, *Pyramidal parametrics*, SIGGRAPH 1983.

mod cells;
mod chart;
mod footprint;
mod lanes;
mod levels;
mod logarithm;
mod lookup;
mod moves;
mod options;
mod sample;
mod texels;
mod tiles;
mod values;

pub use self::levels::{ConstantCubeMap, ConstantTexture, CubeMap, Texture};
pub use self::options::{Detail, MOST_PROBES, Sampler, TextureBorder, TextureFilter};
pub use self::sample::{sample_cube_map, sample_texture};
