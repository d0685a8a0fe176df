//! Which way faces turn, of coverage that was not rasterized here.

use bokashi_core::{Scalar, Tensor};

use super::check_positions;
use super::visibility::Visibility;
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::raster_options::{Cull, RasterOptions};

impl Coverage {
    /// The same coverage, which knows from `clip: [V, 4]` which way its faces turn, and where silhouettes are. `cull`
    /// names the side that was not drawn.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless there is a position for each vertex; [`RenderError::Position`] for one that is not
    /// finite.
    pub fn with_orientations<T: Scalar>(
        mut self,
        clip: &Tensor<T>,
        cull: Cull,
    ) -> Result<Self, RenderError> {
        check_positions("Coverage::with_orientations", &self.mesh, clip.shape(), clip.data())?;
        let options = RasterOptions::new(self.size).cull(cull);
        self.orientations = Visibility::default().orientations(clip.data(), options, &self.mesh);
        Ok(self)
    }
}
