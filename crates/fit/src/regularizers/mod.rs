//! Regularizers of meshes and textures: preferences of a fit where its images do not decide.
//!
//! | file | regularizers |
//! |---|---|
//! | `laplacian_error` | vertices near the mean of their neighbours |
//! | `edge_length` | edges of one length, or short ones |
//! | `normal_consistency` | neighbouring faces in one plane |
//! | `rigid` | as rigid as possible: neighbourhoods that only turn |
//! | `total_variation` | textures without needless change |

mod edge_length;
mod laplacian_error;
mod normal_consistency;
mod rigid;
mod total_variation;
mod vertices;

pub use self::edge_length::edge_length_error;
pub use self::laplacian_error::laplacian_error;
pub use self::normal_consistency::normal_error;
pub use self::rigid::{RigidWeights, Rigidity};
pub use self::total_variation::total_variation;
