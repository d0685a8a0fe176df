//! Losses of images, masks and depths, and measures without a gradient.
//!
//! | file | losses |
//! |---|---|
//! | `penalty` | means of squared, absolute, Huber, Charbonnier and relative errors, by weights or a mask too |
//! | `entrywise` | functions of one number, entry by entry |
//! | `pair` | checks of two images that are compared |
//! | `ssim`, `multiscale_ssim` | structural similarity, at one scale or at several |
//! | `silhouette` | intersection over union of soft masks |
//! | `depth` | absolute errors of depths, up to scale and shift |
//! | `halved`, `pyramid` | an image of half the size; a loss on an image and on its halves |
//! | `metrics` | PSNR, SSIM and intersection over union of tensors and masks |

mod depth;
mod entrywise;
mod halved;
mod metrics;
mod multiscale_ssim;
mod pair;
mod penalty;
mod pyramid;
mod silhouette;
mod ssim;

pub use self::depth::{DepthAlignment, depth_error};
pub use self::halved::halved;
pub use self::metrics::{iou, psnr, ssim};
pub use self::multiscale_ssim::multiscale_ssim_error;
pub(crate) use self::penalty::sum_over_count;
pub use self::penalty::{Penalty, masked_error, mean_error, weighted_error};
pub use self::pyramid::pyramid_error;
pub use self::silhouette::silhouette_error;
pub use self::ssim::ssim_error;
