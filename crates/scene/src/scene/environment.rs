//! The environment of a scene: a panorama, six faces, or one colour.

use std::ops::RangeInclusive;

use bokashi_core::Tensor;

use super::source::Source;
use crate::description::Description;
use crate::environment::cube_from_panorama;
use crate::error::SceneError;
use crate::picture::ColorSpace;

/// Texels along a side of an environment; and where a scene does not say.
const SIDES: RangeInclusive<usize> = 8..=256;
const SIDE: usize = 16;
/// Likewise of a panorama.
const PANORAMA: RangeInclusive<usize> = 8..=64;

impl Source {
    /// The texels of the environment, `[6, S, S, 3]`, where there is one.
    pub(super) fn environment(
        &self,
        description: &Description,
    ) -> Result<Option<Tensor<f32>>, SceneError> {
        let Some(entry) = &description.environment else { return Ok(None) };
        let light = entry.get_ref();
        let check = |side: usize| match SIDES.contains(&side) && side.is_power_of_two() {
            true => Ok(side),
            false => {
                let rule = "the side of a cube map is a power of two from 8 to 256";
                Err(self.wrong(entry, format!("{rule}, and this is {side}")))
            }
        };
        match (&light.image, light.color) {
            (Some(file), None) => {
                let image = self.image(file)?;
                let [width, height] = [image.width, image.height];
                let texels = image.color(ColorSpace::for_picture(&image));
                match light.size {
                    None if height == 6 * width => {
                        let shape = [6, check(width)?, width, 3];
                        Ok(Some(Tensor::from_flat_fn(shape, |k| texels.data()[k])))
                    }
                    size if width == 2 * height => {
                        // At the horizon a texel is as wide as a pixel.
                        let usual = *PANORAMA.end().min(&(width / 4).max(*PANORAMA.start()));
                        let side = size.map_or(1 << usual.ilog2(), |size| size.0);
                        Ok(Some(cube_from_panorama(&texels, check(side)?)))
                    }
                    _ => {
                        let rule = "an environment's image is a panorama, twice as wide as high, or \
                             without `size` six faces, one below the other";
                        let message =
                            format!("{rule}, and {} is {width} x {height}", file.display());
                        Err(self.wrong(entry, message))
                    }
                }
            }
            (None, Some(color)) => {
                let side = check(light.size.map_or(SIDE, |size| size.0))?;
                Ok(Some(Tensor::from_flat_fn([6, side, side, 3], |k| color[k % 3].0 as f32)))
            }
            _ => {
                let rule = "an environment has either `image` or `color`, and perhaps `size`";
                Err(self.wrong(entry, rule))
            }
        }
    }
}
