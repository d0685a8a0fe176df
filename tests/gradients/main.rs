//! Gradients: every operation keeps the laws of `bokashi-check`, and the check catches every wrong
//! adjoint made from it.

mod blends;
mod cameras;
mod distances;
mod exact;
mod layers;
mod light;
mod losses;
mod partition;
mod pictures;
mod rendering;
mod scenes;
mod surfaces;
mod tensors;
mod textures;
