//! One file per question.

mod blur;
mod fits;
mod masks;
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

/// Does a study.
type Do = fn(&Bench) -> Result<Section, FitError>;

/// The study of meshes from files: without a file a full run leaves it out.
pub const MESHES: &str = "meshes";

/// Every study with its name, in the order of the report.
pub(super) const ALL: [(&str, Do); 10] = [
    ("scenes", scenes::study),
    (MESHES, meshes::study),
    ("silhouettes", silhouettes::study),
    ("masks", masks::study),
    ("fits", fits::study),
    ("photographs", photographs::study),
    ("blur", blur::study),
    ("operations", operations::study),
    ("surfaces", surfaces::study),
    ("nodes", nodes::study),
];
