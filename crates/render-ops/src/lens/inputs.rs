//! What the operation is given, and what it gives.

use bokashi_core::{Scalar, TensorError, Var};

use crate::defocus::Iris;
use crate::error::RenderError;
use crate::fragments::Fragments;

pub(super) const NAME: &str = "lens_picture";

/// A thin lens, as variables.
#[derive(Debug, Clone, Copy)]
pub struct ThinLens<'t, T: Scalar> {
    /// The radius, in pixels, of the circle of confusion at infinity: a single number. It is twice the standard
    /// deviation that [`Lens::aperture`](crate::Lens) is.
    pub aperture: Var<'t, T>,
    /// The distance at which the picture is sharp, in units of the scene. A single number.
    pub focus: Var<'t, T>,
}

impl<'t, T: Scalar> ThinLens<'t, T> {
    /// A lens that is as wide however it is focused: of a radius in units of the scene, behind which the image
    /// lies at the focal length of its camera, in pixels. Its circles at infinity have the radius `focal_length
    /// radius / focus`, so that they change with the focus. All three are single numbers.
    ///
    /// # Errors
    /// `TensorError::ForeignVariable` for variables of several tapes, and what the tape refuses of their shapes.
    pub fn from_radius(
        radius: Var<'t, T>,
        focal_length: Var<'t, T>,
        focus: Var<'t, T>,
    ) -> Result<Self, RenderError> {
        let aperture = focal_length.try_mul(radius)?.try_div(focus)?;
        Ok(Self { aperture, focus })
    }
}

/// How a lens draws.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThinLensOptions {
    /// How many pixels of the fragments' image are cut off at each side. What lies beyond the picture is blurred
    /// into it, as far as the largest circle of confusion reaches; corners of an iris with blades reach farther.
    /// Without that margin it is left out, and what lies in the image counts for more.
    pub margin: usize,
    /// The cap on the radius of a circle of confusion, in pixels, from 0 to 1024: without it, it would be infinite at
    /// distance 0. A capped circle has no gradient by distance, aperture or focus.
    pub largest_radius: f64,
    /// The form of the opening.
    pub iris: Iris,
    /// Whether [`LensPicture::piece`] is found.
    #[doc(hidden)]
    pub tells_piece: bool,
}

impl Default for ThinLensOptions {
    /// No margin, circles of at most 64 pixels, and a round iris.
    fn default() -> Self {
        Self { margin: 0, largest_radius: 64.0, iris: Iris::Disc, tells_piece: false }
    }
}

/// What a lens sees of one layer in depth.
#[derive(Debug, Clone, Copy)]
pub struct LensLayer<'a, 't, T: Scalar> {
    /// The layer's fragments, of an image as large as the picture and its margin.
    pub fragments: &'a Fragments<'t, T>,
    /// Colours times their alpha, `[N, C]`.
    pub premultiplied: Var<'t, T>,
    /// How much of what lies behind is hidden, from 0 to 1: `[N]`.
    pub alpha: Var<'t, T>,
    /// Distances along the view axis, `[N]`, from 0 to infinity: those of [`eye_depth`](crate::eye_depth()).
    pub distance: Var<'t, T>,
    /// How the distances change from pixel to pixel, to the right and down, `[N, 2]`: those of
    /// [`eye_depth_slope`](crate::eye_depth_slope()). Without it each fragment is blurred as if it faced the lens,
    /// which is the same where all do. It costs up to a third more where they do not. One
    /// that is not finite moves nothing that is infinitely far.
    pub slope: Option<Var<'t, T>>,
}

/// What [`lens_picture`](crate::lens_picture()) gives.
#[derive(Debug, Clone, Copy)]
pub struct LensPicture<'t, T: Scalar> {
    /// The image `[H, W, C]`, without the margin.
    pub image: Var<'t, T>,
    /// How many fragments were so far out of focus that their circle was cut to the cap, in all layers and with the
    /// margin.
    pub capped: usize,
    /// Tells on which smooth piece the inputs lie: between inputs for which it differs there is a kink.
    #[doc(hidden)]
    pub piece: u64,
}

impl<'t, T: Scalar> LensLayer<'_, 't, T> {
    /// # Errors
    /// As [`lens_picture`](crate::lens_picture()).
    pub(super) fn check(&self, count: usize, channels: usize) -> Result<(), RenderError> {
        let tape = self.premultiplied.tape();
        let expected = [
            (self.premultiplied, &[count, channels][..], "values"),
            (self.alpha, &[count], "alphas"),
            (self.distance, &[count], "distances"),
        ];
        let pairs = [count, 2];
        let slope = self.slope.map(|slope| (slope, &pairs[..], "slopes"));
        for (variable, shape, what) in expected.into_iter().chain(slope) {
            if !std::ptr::eq(variable.tape(), tape) {
                return Err(TensorError::ForeignVariable { operation: NAME }.into());
            }
            if *variable.shape() != *shape {
                let rule = format!("{what} of shape {shape:?}");
                return Err(RenderError::shape(NAME, rule, &variable.shape()));
            }
        }
        let distances = self.distance.value();
        let is_distance = |z: &T| *z >= T::ZERO;
        match distances.data().iter().position(|z| !is_distance(z)) {
            Some(row) => {
                let value = distances.data()[row].to_f64();
                let rule = format!("distances from 0 up, in row {row} too");
                Err(RenderError::value(NAME, rule, value))
            }
            None => Ok(()),
        }
    }

    /// Whether it hides all that lies behind it, and will.
    pub(super) fn is_opaque(&self) -> bool {
        let alpha = self.alpha;
        !alpha.needs_gradient() && alpha.value().data().iter().all(|&alpha| alpha == T::ONE)
    }
}
