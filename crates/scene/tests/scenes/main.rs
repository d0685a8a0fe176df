//! Scenes as their users have them: what their page says, what programs do with them, what fits of them learn,
//! and the laws that hold for all fits.

mod alignment;
mod description;
mod exposures;
mod fields;
mod fits;
mod fixtures;
mod hulls;
mod images;
mod lenses;
mod meshes;
mod metamorphic;
mod poses;
mod ranks;
mod rays;
mod resuming;
mod stack;
mod stage_textures;
mod stages;
mod stopping;
