//! Losses and regularizers of `bokashi-fit`.

pub(crate) mod depth_error;
pub(crate) mod halved;
pub(crate) mod mean_error;
pub(crate) mod silhouette_error;
pub(crate) mod ssim_error;
pub(crate) mod total_variation;
pub(crate) mod vertices;
pub(crate) mod weighted_error;
