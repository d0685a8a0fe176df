//! A lens that knows what hides what.
//!
//! # Forward
//! What a lens sees is an integral over its points. Each surface that a pixel shows, and those close to its
//! outlines that it hides (`disocclusion`, `hiding`), has a circle of confusion (`circles`). What does not face the
//! lens is moved by a part of it (`tilt`). By its radius each surface is shared among a few rungs, blurs of fixed radii
//! (`defocus/rungs`, `surfaces`; `spans` where pixels show nothing else). Each rung is blurred through the iris, its
//! colours and its alpha (`defocus/iris`, `defocus/blur`), and the blurred rungs are put together from front to back
//! (`front_to_back`). Each file has its formulas, and `bands` has the passes over the image.
//!
//! # Backward
//! The same passes from last to first: each file has its own step back beside its step forward.
//!
//! # Where it is not smooth
//! Where a circle passes a rung, where what is left of the lens decides what is seen, where a circle reaches its
//! cap or a shift a whole pixel, and where the visible surface changes. The value steps in the last; where a
//! translucent piece passes what lies at its pixel's centre; and, by less than a thousandth in our scenes, where what
//! is hidden comes within reach of a jump.
//!
//! # Memory
//! A band of 16 rows holds each rung that something in it lies on, over the image's width, and each blurred rung
//! that is seen in it, over the columns where the lens is not yet full. So a picture of two planes holds four
//! rungs, and a floor holds little more than two, cut at other rows. Rungs of 12 pixels and more are blurred at half
//! the size, those of 24 and more at a quarter, and so on to a sixteenth. A backward pass holds the gradients of
//! blurred rungs at their own sizes, and those of fragments by pixel. Blurred rungs and gradients are wide numbers:
//! neighbouring rungs are nearly alike, and gradients of circles are their differences.
//!
//! # Cost
//! 1024 x 1024 pixels, three channels, `f32`, two threads, three hidden layers, in milliseconds, without finding these.
//! Behind it the backward pass with all gradients.
//!
//! | aperture, pixels | 5 | 20 | 80 |
//! |---|---|---|---|
//! | a board in front of a wall in focus | 38, 52 | 39, 59 | 46, 83 |
//! | a floor from the eye through the focus | 49, 61 | 69, 83 | 84, 124 |
//! | the floor with its slopes | 69, 105 | 90, 132 | 103, 170 |
//!
//! # Limits
//! What no ray through the middle of the lens meets is not known: the far side of a ball's rim, and surfaces
//! behind those of the last layer. In focus a surface has no gradient by its distance: its circle is at its
//! minimum.
//!
//! # Source
//! Potmesil and Chakravarty, *Synthetic image generation with a lens and aperture camera model*, ACM TOG 1(2),
//! 1982, for the circle of confusion. The rungs, and how they hide each other, are our own: an integral over the
//! lens is what they are measured against.

mod bands;
mod circles;
mod disocclusion;
mod frame;
mod front_to_back;
mod hiding;
mod pixel_bars;
mod spans;
mod surfaces;
mod tilt;

use std::sync::Arc;

use bokashi_core::parallel::{ENTRIES_PER_PIECE, for_each_item_mut, write_each};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Tape, TensorError, Var};
use smallvec::SmallVec;

use self::bands::{Band, Bench, FillOutcome, Passes, add_piece};
use self::circles::Optics;
use self::disocclusion::{Disocclusion, Visible};
use self::frame::Frame;
use self::front_to_back::Gaps;
use self::pixel_bars::BandBars;
use self::surfaces::{Layer, View};
use crate::background::{Background, Kind};
use crate::coverage::Coverage;
use crate::defocus::{Bands, Blurs, Iris, ROWS, Strips, broken_rule};
use crate::error::RenderError;
use crate::fragments::Fragments;
use crate::picture::{Composite, checked_channels};
use crate::scratch::Workbench;
use crate::size::Size;

const NAME: &str = "lens_picture";

/// A tape keeps 64 inputs of an operation at most: 7 and a slope, and four for each layer behind.
const MOST_BEHIND: usize = 14;

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

/// What [`lens_picture`] gives.
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

/// The picture that a lens sees of surfaces one behind another, before a background that is `far` away.
///
/// `visible` are the fragments of any sampling; with exact coverage, outlines have their gradients. `behind` are
/// the layers at pixel centres that [`depth_layers`](crate::depth_layers()) found of the same mesh, the nearest
/// first. The first of these covers every pixel centre that the visible layer does, and says what hides what: its
/// colours are seen in boundary pixels alone, beside the pieces that cover them. The others are seen beside the
/// outlines of what hides them. Two hidden layers are enough: leave the mesh's back faces out
/// ([`Cull`](crate::Cull)), else its far side counts as one. Without a layer `behind`, nothing but the background
/// is seen behind what is visible.
///
/// Colours, alphas, distances, weights of pieces, the background and both numbers of the lens can have a
/// gradient. For a picture that comes with one depth, and nothing behind it,
/// [`depth_of_field`](crate::depth_of_field()) costs less.
///
/// The background lies at the distance `far`, above 0 or infinite, which has no gradient. An image behind it is as
/// large as the picture with its margin.
///
/// With an aperture of 0, and alphas of the visible and the first hidden layer that are 1 and not learnt, it is
/// [`composite`](crate::composite()), and layers behind are not looked at.
///
/// # Errors
/// - [`RenderError::Shape`] unless the colours of each layer are `[N, C]`, C > 0, its alphas and distances `[N]`,
///   its slopes `[N, 2]`,
///   the background has as many channels, aperture and focus are single numbers; and for fragments that are
///   not whole.
/// - [`RenderError::ExactLayers`] for a layer of exact coverage behind, [`RenderError::LayerSize`] for layers of
///   several sizes, [`RenderError::LayerPixel`] where a layer behind covers a pixel that the one before does not.
/// - `TensorError::Value` for a distance that is negative or NaN, an aperture that is negative or not finite, a
///   focus that is not finite and positive, a largest radius that is not between 0 and 1024, a margin that leaves
///   nothing of the picture, an iris of fewer than 3 or more than 16 blades or of a rotation that is not finite, a
///   background that is not at a distance above 0, more than 14 layers behind.
/// - `TensorError::ForeignVariable` for variables of several tapes.
#[inline(never)]
pub fn lens_picture<'t, T: Scalar>(
    visible: LensLayer<'_, 't, T>,
    behind: &[LensLayer<'_, 't, T>],
    background: Background<'t, T>,
    far: f64,
    lens: ThinLens<'t, T>,
    options: &ThinLensOptions,
) -> Result<LensPicture<'t, T>, RenderError> {
    let tape = visible.premultiplied.tape();
    if behind.len() > MOST_BEHIND {
        let rule = format!("at most {MOST_BEHIND} layers behind");
        return Err(RenderError::value(NAME, rule, behind.len() as f64));
    }
    let own = visible.fragments.checked_coverage(NAME, tape)?;
    own.check_shaded(NAME)?;
    let size = own.size();
    let channels = checked_channels(NAME, visible.premultiplied, own.count())?;
    check_numbers(tape, lens, far, options)?;
    let least = size.width.min(size.height);
    if 2 * options.margin >= least {
        let rule = format!("a margin of less than half of {least} pixels");
        return Err(RenderError::value(NAME, rule, options.margin as f64));
    }
    visible.check(own.count(), channels)?;
    let backdrop = background.behind(NAME, tape, size, channels)?;
    let mut inputs: List<'t, T> = SmallVec::new();
    inputs.extend([backdrop.values, lens.aperture, lens.focus]);
    inputs.extend([visible.premultiplied, visible.alpha, visible.distance]);
    inputs.extend(visible.fragments.weight);
    let hidden = list_hidden(behind, size, channels, &mut inputs)?;
    let slopes = std::iter::once(&visible).chain(behind).map(|layer| {
        inputs.extend(layer.slope);
        layer.slope.map(|_| inputs.len() - 1)
    });
    let slopes = slopes.collect();
    let hides = std::iter::once(&visible).chain(behind.first());
    if lens.aperture.item() == T::ZERO && hides.clone().all(LensLayer::is_opaque) {
        let values = visible.premultiplied;
        let image = Composite::from_values(values, visible.fragments, background)?.image()?;
        let margin = options.margin;
        let image = image.slice(0, margin..size.height - margin)?;
        let image = image.slice(1, margin..size.width - margin)?;
        return Ok(LensPicture { image, capped: 0, piece: 0 });
    }
    let has_weights = visible.fragments.weight.is_some();
    let frame = Frame { size, margin: options.margin };
    let (kind, options) = (backdrop.kind, *options);
    let op = DrawLens { visible: own, hidden, slopes, kind, has_weights, far, frame, options };
    let look = |saved: &Saved<T>| [saved.capped as u64, saved.piece];
    let (outputs, [capped, piece]) = tape.record_with(op, &inputs, look)?;
    Ok(LensPicture { image: outputs[0], capped: capped as usize, piece })
}

/// Inputs: few layers need no memory.
type List<'t, T> = SmallVec<[Var<'t, T>; 24]>;

/// Adds the inputs of all layers behind but their slopes; returns what they cover.
///
/// # Errors
/// As [`lens_picture`].
fn list_hidden<'t, T: Scalar>(
    behind: &[LensLayer<'_, 't, T>],
    size: Size,
    channels: usize,
    inputs: &mut List<'t, T>,
) -> Result<SmallVec<[Arc<Coverage>; 4]>, RenderError> {
    let mut hidden = SmallVec::new();
    for layer in behind {
        let coverage = layer.fragments.checked_coverage(NAME, layer.premultiplied.tape())?;
        if coverage.is_exact() {
            return Err(RenderError::ExactLayers { operation: NAME });
        }
        if coverage.size() != size {
            return Err(RenderError::LayerSize { expected: size, given: coverage.size() });
        }
        layer.check(coverage.count(), channels)?;
        inputs.extend([layer.premultiplied, layer.alpha, layer.distance]);
        hidden.push(coverage);
    }
    Ok(hidden)
}

/// # Errors
/// As [`lens_picture`].
fn check_numbers<T: Scalar>(
    tape: &Tape<T>,
    lens: ThinLens<'_, T>,
    far: f64,
    options: &ThinLensOptions,
) -> Result<(), RenderError> {
    for (number, what) in [(lens.aperture, "aperture"), (lens.focus, "focus")] {
        if !std::ptr::eq(number.tape(), tape) {
            return Err(TensorError::ForeignVariable { operation: NAME }.into());
        }
        if number.shape().size() != 1 {
            let rule = format!("a single number for the {what}");
            return Err(RenderError::shape(NAME, rule, &number.shape()));
        }
    }
    let [aperture, focus] = [lens.aperture, lens.focus].map(|number| number.item().to_f64());
    let largest = options.largest_radius;
    let rules = [
        (aperture >= 0.0 && aperture.is_finite(), aperture, "a finite aperture of at least 0"),
        (focus > 0.0 && focus.is_finite(), focus, "a finite and positive focus"),
        (far > 0.0, far, "a background at a distance above 0"),
        ((0.0..=1024.0).contains(&largest), largest, "a largest radius from 0 to 1024 pixels"),
    ];
    let broken = rules.into_iter().find(|(holds, ..)| !holds);
    match broken.map(|(_, value, rule)| (rule, value)).or_else(|| broken_rule(options.iris)) {
        Some((rule, value)) => Err(RenderError::value(NAME, rule, value)),
        None => Ok(()),
    }
}

impl<'t, T: Scalar> LensLayer<'_, 't, T> {
    /// # Errors
    /// As [`lens_picture`].
    fn check(&self, count: usize, channels: usize) -> Result<(), RenderError> {
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
    fn is_opaque(&self) -> bool {
        let alpha = self.alpha;
        !alpha.needs_gradient() && alpha.value().data().iter().all(|&alpha| alpha == T::ONE)
    }
}

/// Inputs: a background `[C]` or `[H, W, C]`, aperture, focus; of the visible layer colours `[N, C]`, alphas `[N]`
/// and distances `[N]`, and perhaps weights `[K]`; then colours, alphas and distances of each layer behind; then the
/// slopes `[N, 2]` of layers that have some.
struct DrawLens {
    visible: Arc<Coverage>,
    hidden: SmallVec<[Arc<Coverage>; 4]>,
    /// The input of each layer's slopes, if it has some.
    slopes: SmallVec<[Option<usize>; 4]>,
    kind: Kind,
    has_weights: bool,
    far: f64,
    frame: Frame,
    options: ThinLensOptions,
}

/// What a backward pass reads, and memory.
#[derive(Debug)]
struct Saved<T: Scalar> {
    blurs: Blurs,
    gaps: Gaps,
    /// Per layer the radii of its circles.
    radii: Vec<Vec<T>>,
    disocclusion: Disocclusion,
    keeps_hidden: bool,
    /// The rungs by band, and the blurred rungs by band of what is shown.
    sources: Vec<Strips<T::Wide>>,
    outcomes: Vec<FillOutcome>,
    bands: Vec<Band<T::Wide>>,
    capped: usize,
    piece: u64,
    benches: Workbench<Bench<T::Wide>>,
    /// Memory of a backward pass: by band of what is shown, and of the image.
    strip_bars: Vec<Strips<T::Wide>>,
    band_bars: Vec<BandBars<T::Wide>>,
}

impl<T: Scalar> Default for Saved<T> {
    fn default() -> Self {
        Self {
            blurs: Blurs::default(),
            gaps: Gaps::default(),
            radii: Vec::new(),
            disocclusion: Disocclusion::default(),
            keeps_hidden: false,
            sources: Vec::new(),
            outcomes: Vec::new(),
            bands: Vec::new(),
            capped: 0,
            piece: 0,
            benches: Workbench::default(),
            strip_bars: Vec::new(),
            band_bars: Vec::new(),
        }
    }
}

/// Layers, and their coverage behind the visible one: few.
type Layers<'a, T> = SmallVec<[Layer<'a, T>; 4]>;
type Behind<'a> = SmallVec<[&'a Coverage; 4]>;

impl DrawLens {
    /// The first input of each layer, and its coverage.
    fn layers(&self) -> impl Iterator<Item = (usize, &Coverage)> + '_ {
        let behind = 6 + usize::from(self.has_weights);
        let hidden = self.hidden.iter().enumerate();
        let hidden = hidden.map(move |(k, layer)| (behind + 3 * k, &**layer));
        std::iter::once((3, &*self.visible)).chain(hidden)
    }

    fn optics<T: Scalar>(&self, [aperture, focus]: [&[T]; 2]) -> Optics<T::Wide> {
        let [aperture, focus] = [aperture, focus].map(|number| number[0].widen());
        Optics { aperture, focus, largest: self.options.largest_radius }
    }

    /// Finds the radii of all circles; returns how many are capped.
    fn find_radii<T: Scalar>(&self, inputs: &Inputs<'_, T>, radii: &mut Vec<Vec<T>>) -> usize {
        let optics = self.optics([inputs.data(1), inputs.data(2)]);
        radii.resize_with(1 + self.hidden.len(), Vec::new);
        let cap = T::from_f64(self.options.largest_radius);
        let mut capped = 0;
        for ((first, _), radii) in self.layers().zip(radii) {
            let distances = inputs.data(first + 2);
            radii.resize(distances.len(), T::ZERO);
            write_each(radii, ENTRIES_PER_PIECE, |k| {
                T::narrow(optics.radius(distances[k].widen()).0)
            });
            // A circle may be as large as the cap by itself.
            let is_capped =
                |(radius, z): &(&T, &T)| radius.abs() >= cap && optics.radius(z.widen()).1;
            capped += radii.iter().zip(distances).filter(is_capped).count();
        }
        capped
    }

    /// Finds where hidden surfaces can be seen.
    fn find_jumps<T: Scalar>(
        &self,
        inputs: &Inputs<'_, T>,
        radii: &[Vec<T>],
        disocclusion: &mut Disocclusion,
    ) {
        let optics = self.optics([inputs.data(1), inputs.data(2)]);
        let at_centers = self.hidden.first().map(|first| {
            let input = 6 + usize::from(self.has_weights);
            (&**first, inputs.data(input + 1), &radii[1][..])
        });
        let visible = Visible {
            at_centers,
            coverage: &self.visible,
            alphas: inputs.data(4),
            radii: &radii[0],
            weights: if self.has_weights { inputs.data(6) } else { &[] },
            background: optics.radius(T::Wide::from_f64(self.far)).0.to_f64(),
        };
        disocclusion.update(&visible, self.options.iris);
    }

    /// All surfaces, of the operation's inputs.
    fn view<'a, T: Scalar>(
        &'a self,
        input: impl Fn(usize) -> &'a [T],
        saved: (&'a Blurs, &'a [Vec<T>], &'a Disocclusion, bool),
        work: impl FnOnce(&View<'_, T>),
    ) {
        let (blurs, radii, disocclusion, keeps_hidden) = saved;
        let layer = |((first, _), (radii, slopes)): ((usize, &Coverage), (&'a Vec<T>, _))| Layer {
            colors: input(first),
            alphas: input(first + 1),
            distances: input(first + 2),
            slopes: Option::map_or(slopes, &[][..], &input),
            radii,
        };
        let each = radii.iter().zip(self.slopes.iter().copied());
        let layers: Layers<'_, T> = self.layers().zip(each).map(layer).collect();
        let behind: Behind<'_> = self.hidden.iter().map(|layer| &**layer).collect();
        let optics = self.optics([input(1), input(2)]);
        let reference = self.reference(input(0));
        let sky = optics.circle(T::Wide::from_f64(self.far));
        work(&View {
            channels: reference.len(),
            layers: &layers,
            weights: if self.has_weights { input(6) } else { &[] },
            visible: &self.visible,
            behind: &behind,
            rungs: &blurs.rungs,
            disocclusion,
            optics,
            sky,
            sky_position: blurs.rungs.locate(sky.radius),
            background: input(0),
            kind: self.kind,
            reference: &reference,
            keeps_hidden,
        });
    }

    fn channels(&self, background: usize) -> usize {
        match self.kind {
            Kind::Color => background,
            Kind::Image => background / self.frame.size.pixels(),
        }
    }

    /// The colour that rungs hold the difference to.
    fn reference<T: Scalar>(&self, background: &[T]) -> SmallVec<[T; 4]> {
        match self.kind {
            Kind::Color => SmallVec::from_slice(background),
            Kind::Image => SmallVec::from_elem(T::ZERO, self.channels(background.len())),
        }
    }

    /// Adds the gradients of all layers.
    fn give_layers<T: Scalar>(
        &self,
        bands: &[BandBars<T::Wide>],
        channels: usize,
        gradients: &mut Accumulators<'_, T>,
    ) {
        for (layer, (first, coverage)) in self.layers().enumerate() {
            for (list, width) in [channels, 1, 1, 2].into_iter().enumerate() {
                let input = if list == 3 { self.slopes[layer] } else { Some(first + list) };
                let Some(bar) = input.and_then(|input| gradients.get(input)) else { continue };
                let entries = bar.entries();
                let centers = &mut entries[..coverage.centers() * width];
                coverage.centers.for_each_band_mut(width, centers, |slots, first, entries| {
                    for run in coverage.centers.in_slots(slots) {
                        let band = run.pixel as usize / self.frame.size.width / ROWS;
                        let start = band * ROWS * self.frame.size.width;
                        let from = bands[band].layers[layer].run_bars(list, width, start, run);
                        let to = &mut entries[(run.fragment as usize - first) * width..];
                        for (to, &from) in to.iter_mut().zip(from.unwrap_or_default()) {
                            *to += T::narrow(from);
                        }
                    }
                });
                if layer == 0 {
                    let start = [0, channels, channels + 1, channels + 2][list];
                    add_pieces(bands, [channels + 4, start, width], entries);
                }
            }
        }
        if self.has_weights
            && let Some(bar) = gradients.get(6)
        {
            let entries = bar.entries();
            for &(piece, bar) in bands.iter().flat_map(|band| &band.weights) {
                entries[piece as usize - self.visible.centers()] += T::narrow(bar);
            }
        }
    }

    /// Adds the gradients of the background, of aperture and of focus.
    fn give_optics<T: Scalar>(
        &self,
        bands: &[BandBars<T::Wide>],
        channels: usize,
        gradients: &mut Accumulators<'_, T>,
    ) {
        if let Some(bar) = gradients.get(0) {
            let entries = bar.entries();
            let row = ROWS * self.frame.size.width * channels;
            match self.kind {
                Kind::Color => {
                    for (channel, to) in entries.iter_mut().enumerate() {
                        let sum: T::Wide = bands.iter().map(|band| band.background[channel]).sum();
                        *to += T::narrow(sum);
                    }
                }
                Kind::Image => {
                    for (to, band) in entries.chunks_mut(row).zip(bands) {
                        let pairs = to.iter_mut().zip(&band.background);
                        pairs.for_each(|(to, &bar)| *to += T::narrow(bar));
                    }
                }
            }
        }
        for k in 0..2 {
            if let Some(bar) = gradients.get(1 + k) {
                let sum: T::Wide = bands.iter().map(|band| band.optics[k]).sum();
                bar.add_each(|_| T::narrow(sum));
            }
        }
    }
}

/// Adds a part of the gradients of visible pieces, `width` numbers of each from `start` on.
fn add_pieces<T: Scalar>(
    bands: &[BandBars<T::Wide>],
    [count, start, width]: [usize; 3],
    entries: &mut [T],
) {
    for band in bands {
        for (&piece, bars) in band.pieces.iter().zip(band.piece_bars.chunks_exact(count)) {
            let to = &mut entries[piece as usize * width..][..width];
            to.iter_mut().zip(&bars[start..]).for_each(|(to, &bar)| *to += T::narrow(bar));
        }
    }
}

impl<T: Scalar> Op<T> for DrawLens {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Saved<T>,
    ) -> Result<(), RenderError> {
        let Saved { blurs, gaps, radii, disocclusion, sources, outcomes, bands, benches, .. } =
            saved;
        saved.capped = self.find_radii(inputs, radii);
        saved.keeps_hidden = self.layers().any(|(first, _)| inputs.needs(first + 1));
        if blurs.reach(self.options.largest_radius, self.options.iris) {
            gaps.update(&blurs.rungs);
        }
        self.find_jumps(inputs, radii, disocclusion);
        let (frame, shown) = (self.frame, self.frame.shown_size());
        let count = frame.size.height.div_ceil(ROWS);
        sources.resize_with(count, Strips::default);
        outcomes.resize_with(count, FillOutcome::default);
        let passes = Passes { blurs, gaps, frame, benches };
        self.view(
            |k| inputs.data(k),
            (blurs, radii, disocclusion, saved.keeps_hidden),
            |view| {
                passes.fill_rungs(view, sources, outcomes);
            },
        );
        if let Some([layer, pixel]) = outcomes.iter().find_map(|outcome| outcome.fault) {
            return Err(RenderError::LayerPixel { layer, pixel });
        }
        for strip in sources.iter().flat_map(Strips::as_slice) {
            blurs.use_rung(strip.rung);
        }
        bands.resize_with(shown.height.div_ceil(ROWS), Band::default);
        let channels = self.channels(inputs.data(0).len());
        let out = outputs.push([shown.height, shown.width, channels]);
        let source = Bands { bands: sources, first: 0 };
        let reference = self.reference(inputs.data(0));
        let tells_piece = self.options.tells_piece;
        let passes = Passes { blurs, gaps, frame, benches };
        passes.see(source, &reference, tells_piece, bands, out);
        saved.piece = 0;
        if tells_piece {
            let pieces = outcomes.iter().map(|outcome| outcome.piece);
            let pieces = pieces.chain(bands.iter().map(|band| band.piece));
            pieces.for_each(|piece| add_piece(&mut saved.piece, piece));
        }
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        (0..inputs.len()).fold(Keep::NOTHING, Keep::input)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Saved<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Saved { blurs, gaps, radii, disocclusion, sources, bands, benches, .. } = saved;
        let (strip_bars, band_bars) = (&mut saved.strip_bars, &mut saved.band_bars);
        strip_bars.resize_with(bands.len(), Strips::default);
        let passes = Passes { blurs, gaps, frame: self.frame, benches };
        passes.pull_back_seen(bands, kept.only_upstream(), strip_bars);
        band_bars.resize_with(sources.len(), BandBars::default);
        let blurs = &*blurs;
        self.view(
            |k| kept.input(k),
            (blurs, radii, disocclusion, saved.keeps_hidden),
            |view| {
                for_each_item_mut(band_bars, |band, found| {
                    passes.pull_back_rungs(view, &sources[band], strip_bars, band, found);
                });
            },
        );
        let channels = self.channels(kept.input(0).len());
        self.give_optics(band_bars, channels, gradients);
        self.give_layers(band_bars, channels, gradients);
    }

    fn saved_bytes(&self, saved: &Saved<T>) -> usize {
        let blurred = saved.bands.iter().map(|band| band.blurred.bytes());
        let strips: usize = saved.sources.iter().map(Strips::bytes).chain(blurred).sum();
        strips + saved.radii.iter().map(|radii| size_of_val(&radii[..])).sum::<usize>()
    }
}
