//! One file per question.

mod blur;
mod fits;
mod lens;
mod meshes;
mod nodes;
mod operations;
mod photographs;
mod scenes;
mod silhouettes;
mod surfaces;

use bokashi_fit::FitError;
use bokashi_report::Section;

use crate::bench::setting::Bench;

/// A question, and what answers it.
pub(super) struct Study {
    pub(super) name: &'static str,
    /// The names of its tables, some of which it may leave out. Their files are checked before it is done.
    pub(super) tables: &'static [&'static str],
    pub(super) run: fn(&Bench) -> Result<Section, FitError>,
}

/// The study of meshes from files: without a file a full run leaves it out.
pub const MESHES: &str = "meshes";

/// Every study, in the order of the report.
pub(super) const ALL: [Study; 12] = [
    Study { name: "scenes", tables: &["scenes", "scene_samples"], run: scenes::study },
    Study {
        name: MESHES,
        tables: &["meshes", "meshes_times", "meshes_counts", "meshes_errors"],
        run: meshes::study,
    },
    Study {
        name: "silhouettes",
        tables: &["silhouettes", "silhouettes_largest", "silhouettes_pixels", "silhouettes_times"],
        run: silhouettes::study,
    },
    Study { name: "fits", tables: &["fits_to_errors", "fits_ends"], run: fits::study },
    Study {
        name: "photographs",
        tables: &["photographs_ends", "photographs_to_errors", "photographs_known"],
        run: photographs::study,
    },
    Study { name: "blur", tables: &["blur_targets", "blur_libraries", "blur"], run: blur::study },
    Study { name: "lens", tables: &["lens", "lens_random", "lens_others"], run: lens::study },
    Study { name: "lens_fits", tables: &["lens_fits"], run: lens::fits },
    Study { name: "lens_times", tables: &["lens_times"], run: lens::times },
    Study { name: "operations", tables: &["operations"], run: operations::study },
    Study { name: "surfaces", tables: &["surfaces", "views"], run: surfaces::study },
    Study { name: "nodes", tables: &["nodes"], run: nodes::study },
];
