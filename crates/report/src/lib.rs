//! Figures, pictures and pages: what a report is made of, whatever it reports.
//!
//! A [`Figure`] is drawn as SVG, a picture is a PNG, a [`viewer()`] turns meshes, and a [`Document`]
//! is a page of [`Section`]s that needs nothing beside it. Written into a folder, its pages name each
//! other. Each file is written whole or not at all.

mod animation;
mod axis;
mod digits;
mod document;
mod error;
mod figure;
mod figures;
mod frame;
mod markup;
mod picture;
mod quartiles;
mod rgb_image;
mod section;
mod table;
mod viewer;

pub use animation::animation;
pub use axis::{Scale, grouped};
pub use digits::{digits, plain};
pub use document::{About, Document, Rendered, style};
pub use error::ReportError;
pub use figure::{Curve, Figure, INK, PALETTE, Stroke};
pub use figures::Figures;
pub use frame::framed;
pub use markup::{data_uri, escaped};
pub use picture::{enlarged, picture_of, png, sheet};
pub use quartiles::{median, quantiles, quartiles};
pub use rgb_image::RgbImage;
pub use section::{Captioned, PICTURE_HEIGHT, Section, wrapped};
pub use table::{Cell, Column, Table};
pub use viewer::{VIEWER_SCRIPT, ViewerMesh, ViewerTexture, viewer, viewer_data};
