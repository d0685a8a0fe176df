//! How true is a lens, and at what time?
//!
//! Scenes of several kinds, drawn by `lens_picture` and by `depth_of_field`, against the mean of pinhole pictures
//! through points of the lens: pictures, gradients, fits, times.

mod errors;
mod fits;
mod measure;
mod scenes;
mod times;

use bokashi_fit::FitError;
use bokashi_report::Section;

use crate::bench::setting::Bench;

pub(super) fn study(bench: &Bench) -> Result<Section, FitError> {
    let points = errors::points(bench.effort);
    let note = format!(
        "Pictures of 96 px; K is the radius in pixels of the circle of confusion at infinity, f the focus. The \
         truth is the mean of pinhole pictures through {} points of the lens, with exact coverage, on two spirals \
         whose difference gives its noise. RMS in percent of full intensity. By K and by f: the projection of a \
         gradient of the picture on the truth's difference over 3 %, and the norm of its error, as shares of that \
         difference. Each table has first `lens_picture`, then `depth_of_field` (D). On the page, what misses its \
         target is flagged.",
        2 * points[0]
    );
    let mut study = Section::new("lens", "A lens against the points of the lens", note);
    study.push_tables(errors::tables(bench.effort)?);
    Ok(study)
}

pub(super) fn fits(bench: &Bench) -> Result<Section, FitError> {
    let note = format!(
        "Pictures of 96 px that show the truth, {} starts each, of which every number is a sixth to three tenths \
         off, times or divided; {} steps of Adam on the mean squared error, f64. K is the aperture, f the focus, z \
         the distance of what is in front, which is learnt where more than two circles are seen. Circles: the mean \
         difference of the radii of all pixels' circles of confusion. Medians over the starts and the worst; first \
         `lens_picture`, then `depth_of_field` (D).",
        fits::seeds(bench.effort),
        fits::steps(bench.effort)
    );
    let mut study = Section::new("lens_fits", "A lens fitted to the points of the lens", note);
    study.push_table(fits::table(bench.effort)?);
    Ok(study)
}

pub(super) fn times(bench: &Bench) -> Result<Section, FitError> {
    let note = "A step draws the picture, compares it, and has the gradients by aperture and focus where that is \
                said: without a lens there are none. Views are drawn one after the other. `lens_picture` with n x n \
                samples finds layers, lights them and applies the lens at n times the size, and takes means over \
                pixels. Times f32, one thread; errors, as in the tables of errors, f64. The last panels have the \
                errors of gradients, the root of the mean of both squares.";
    let mut study = Section::new("lens_times", "A lens: error against time", note);
    let (table, figures) = times::study(bench)?;
    study.push_figures(figures);
    study.push_table(table);
    Ok(study)
}
