//! A view of a scene: an image, and the camera that took it.

use std::path::{Path, PathBuf};

use bokashi_core::Tensor;

use crate::cameras::Camera;
use crate::description::ViewLens;
use crate::error::{Location, SceneError};
use crate::folder::Folder;
use crate::picture::{ColorSpace, Mask, Picture};

/// An image, and the camera that took it.
#[derive(Debug, Clone)]
pub struct SceneView {
    /// What results call it.
    pub name: String,
    /// The image, in the scene's folder.
    pub image: Option<PathBuf>,
    /// An image that shows where the objects are: see [`Mask`].
    pub mask: Option<PathBuf>,
    /// How numbers of the image stand for light, where the format does not tell.
    pub color_space: Option<ColorSpace>,
    /// Whether it is measured and never learnt from.
    pub held_out: bool,
    /// How much its light is multiplied, in stops, besides the pipeline's exposure.
    pub exposure: f64,
    /// The camera.
    pub camera: Camera,
    /// What its lens has in place of the pipeline's numbers.
    pub lens: ViewLens,
}

impl SceneView {
    /// Where the objects are, `[H, W]`, if there is a mask: its file, or the image's opacity.
    ///
    /// # Errors
    /// Whatever is wrong with the file; [`SceneError::Content`] for one of another size than the camera's.
    pub(crate) fn read_mask(&self, folder: &Folder) -> Result<Option<Tensor<f32>>, SceneError> {
        match (&self.mask, &self.image) {
            (None, Some(image)) => Ok(self.read_picture(folder, image)?.opacity()),
            (Some(mask), _) => {
                let location = Location::new(folder.join(mask));
                let picture = self.read_picture(folder, mask)?;
                Ok(Some(Mask::from_picture(&picture, &location)?.share))
            }
            (None, None) => Ok(None),
        }
    }

    /// The image of a file, which has the size of the camera's images.
    ///
    /// # Errors
    /// As [`SceneView::read_mask`].
    pub(crate) fn read_picture(&self, folder: &Folder, file: &Path) -> Result<Picture, SceneError> {
        let size = self.camera.size;
        Picture::read_sized(folder, file, [size.width, size.height])
    }
}
