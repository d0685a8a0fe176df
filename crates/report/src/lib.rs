//! Figures, pictures and pages: what a report is made of, whatever it reports.
//!
//! A [`Figure`] is drawn as SVG, a picture is a PNG, a [`viewer()`] turns meshes, and a [`Document`]
//! is a page that needs nothing beside it; [`add_page`] writes it into a folder whose pages then name
//! each other. Each file is written whole or not at all.

mod animation;
mod axis;
mod digits;
mod document;
mod error;
mod figure;
mod markup;
mod panel;
mod picture;
mod quartiles;
mod rgb_image;
mod viewer;

pub use animation::animation;
pub use axis::{Scale, grouped};
pub use digits::{digits, plain};
pub use document::{Document, Section, add_page, style};
pub use error::ReportError;
pub use figure::{Curve, Figure, INK, PALETTE, SIZES, Stroke};
pub use markup::{data_uri, escaped};
pub use panel::{Panel, legend_line, row};
pub use picture::{enlarged, picture_of, png, sheet};
pub use quartiles::{quantiles, quartiles};
pub use rgb_image::RgbImage;
pub use viewer::{VIEWER_SCRIPT, ViewerMesh, ViewerTexture, viewer, viewer_data};
