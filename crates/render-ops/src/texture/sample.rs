//! The operation that looks textures up.

use std::ops::Range;

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Shape, Var};
use smallvec::SmallVec;

use super::cells::Extents;
use super::chart::{Chart, Cube, Plane};
use super::levels::{CubeMap, Texture};
use super::lookup::Lookup;
use super::moves::{Wanted, add_moves};
use super::options::{Detail, MOST_PROBES, Sampler, TextureFilter};
use super::texels::{Terms, TexelSums};
use super::values::{Level, Values};
use crate::dispatch::{dispatch_256, dispatch_special};
use crate::error::RenderError;

/// Samples of a texture at `coordinates: [N, 2]`, in the order (u, v): `[N, C]`.
///
/// (0, 0) is the upper left corner of the texture, whose row 0 is on top, and (1, 1) the lower right
/// corner. Gradients go to the texels of all levels, to the coordinates, and to the level or to the
/// differentials and the bias. A texture of one level needs no detail and looks at none.
///
/// It costs some 15 ns of one core per sample with mipmaps and three channels. The gradients of texels
/// and coordinates cost three times as much, those of differentials half as much again. Each probe of
/// an anisotropic filter costs as much as a sample.
///
/// # Errors
/// - [`RenderError::Shape`] unless the coordinates are `[N, 2]`, a level `[N]` or a single number, and
///   differentials `[N, 2, 2]`.
/// - [`RenderError::NotFinite`] for a coordinate, a level, a bias or a differential that is infinite or
///   NaN.
/// - [`RenderError::BadSampler`] for a number of probes that is not from 1 to [`MOST_PROBES`], or probes
///   without differentials.
/// - `TensorError::ForeignVariable` for variables of several tapes.
#[inline(never)]
pub fn sample_texture<'t, T: Scalar>(
    texture: &Texture<'t, T>,
    coordinates: Var<'t, T>,
    detail: Detail<'t, T>,
    sampler: Sampler,
) -> Result<Var<'t, T>, RenderError> {
    sample(Plane { borders: sampler.borders }, &texture.levels, coordinates, detail, sampler)
}

/// Samples of a cube map in `directions: [N, 3]`, of any length but 0: `[N, C]`. Samples go on over the
/// edges of the faces, so no edge is seen.
///
/// Gradients and cost are those of [`sample_texture`]. The sampler's borders are not asked for.
///
/// # Errors
/// As [`sample_texture`], with directions `[N, 3]` and differentials `[N, 3, 2]`; and
/// [`RenderError::Direction`] for a direction of length 0.
#[inline(never)]
pub fn sample_cube_map<'t, T: Scalar>(
    map: &CubeMap<'t, T>,
    directions: Var<'t, T>,
    detail: Detail<'t, T>,
    sampler: Sampler,
) -> Result<Var<'t, T>, RenderError> {
    sample(Cube, &map.levels, directions, detail, sampler)
}

fn sample<'t, T: Scalar, C: Chart<K>, const K: usize>(
    chart: C,
    levels: &[Var<'t, T>],
    coordinates: Var<'t, T>,
    detail: Detail<'t, T>,
    sampler: Sampler,
) -> Result<Var<'t, T>, RenderError> {
    let probes = sampler.filter.probes();
    if !(1..=MOST_PROBES).contains(&probes) {
        let rule = "from 1 to 8 probes";
        return Err(RenderError::BadSampler { operation: C::OPERATION, rule, given: probes });
    }
    let top = sampler.coarsest.unwrap_or(usize::MAX).min(levels.len() - 1);
    let mut inputs: SmallVec<[Var<'t, T>; 20]> = SmallVec::new();
    inputs.push(coordinates);
    let mut kind = Kind::Finest;
    match detail {
        Detail::Finest => {}
        // A single level is the level, whatever its detail.
        Detail::Level(_) | Detail::Differentials { .. } if top == 0 && probes == 1 => {
            coordinates.tape().leave_out(C::OPERATION, "detail: there is a single level");
        }
        Detail::Level(level) => {
            inputs.push(level);
            kind = Kind::Level;
        }
        Detail::Differentials { differentials, bias } => {
            inputs.push(differentials);
            kind = Kind::Differentials;
            if let Some(bias) = bias {
                inputs.push(bias);
                kind = Kind::BiasedDifferentials;
            }
        }
    }
    if probes > 1 && !matches!(kind, Kind::Differentials | Kind::BiasedDifferentials) {
        let rule = "differentials for more than one probe";
        return Err(RenderError::BadSampler { operation: C::OPERATION, rule, given: probes });
    }
    inputs.extend_from_slice(&levels[..=top]);
    let op = Sample { chart, filter: sampler.filter, kind };
    coordinates.tape().apply(op, &inputs)
}

/// What stands between the coordinates and the levels in the inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Nothing.
    Finest,
    /// The level.
    Level,
    /// Differentials.
    Differentials,
    /// Differentials and a bias.
    BiasedDifferentials,
}

impl Kind {
    /// The input that is the first level.
    fn first_level(self) -> usize {
        match self {
            Self::Finest => 1,
            Self::Level | Self::Differentials => 2,
            Self::BiasedDifferentials => 3,
        }
    }
}

/// Inputs: coordinates `[N, K]`, what `kind` says, levels. Output: `[N, C]`.
struct Sample<C, const K: usize> {
    chart: C,
    filter: TextureFilter,
    kind: Kind,
}

type AllExtents<T> = SmallVec<[Extents<T>; 16]>;

/// Samples in one piece of work.
const SAMPLES_PER_PIECE: usize = 1 << 11;

/// # Errors
/// [`RenderError::NotFinite`] unless all of `numbers` are finite.
fn check_finite<T: Scalar>(
    operation: &'static str,
    what: &'static str,
    numbers: &[T],
    width: usize,
) -> Result<(), RenderError> {
    let is_finite = |chunk: &[T]| chunk.iter().fold(true, |all, number| all & number.is_finite());
    if numbers.chunks(1024).all(is_finite) {
        return Ok(());
    }
    let index = numbers.iter().position(|number| !number.is_finite()).expect("it was found above");
    let value = numbers[index].to_f64();
    Err(RenderError::NotFinite { operation, what, row: index / width.max(1), value })
}

impl<C: Chart<K>, const K: usize> Sample<C, K> {
    /// # Errors
    /// [`RenderError::Shape`] for inputs of a wrong shape.
    fn check_shapes<T: Scalar>(&self, inputs: &Inputs<'_, T>) -> Result<usize, RenderError> {
        let wrong = |rule: String, shape: &Shape| RenderError::Shape {
            operation: C::OPERATION,
            rule,
            shape: shape.clone(),
        };
        let what = if K == 2 { "coordinates" } else { "directions" };
        let count = match **inputs.shape(0) {
            [count, k] if k == K => count,
            _ => return Err(wrong(format!("{what} of shape [N, {K}]"), inputs.shape(0))),
        };
        let numbers = |i: usize, what: &str| {
            let shape = inputs.shape(i);
            if shape.size() != 1 && **shape != [count] {
                let rule = format!("{what} of shape [{count}], or a single number");
                return Err(wrong(rule, shape));
            }
            Ok(())
        };
        match self.kind {
            Kind::Finest => {}
            Kind::Level => numbers(1, "levels")?,
            Kind::Differentials | Kind::BiasedDifferentials => {
                if **inputs.shape(1) != [count, K, 2] {
                    let rule = format!("differentials of shape [{count}, {K}, 2]");
                    return Err(wrong(rule, inputs.shape(1)));
                }
                if self.kind == Kind::BiasedDifferentials {
                    numbers(2, "a bias")?;
                }
            }
        }
        Ok(count)
    }

    /// # Errors
    /// [`RenderError::NotFinite`] and [`RenderError::Direction`].
    fn check_numbers<T: Scalar>(&self, inputs: &Inputs<'_, T>) -> Result<(), RenderError> {
        let (operation, coordinates) = (C::OPERATION, inputs.data(0));
        check_finite(operation, if K == 2 { "coordinates" } else { "directions" }, coordinates, K)?;
        match self.kind {
            Kind::Finest => {}
            Kind::Level => check_finite(operation, "levels", inputs.data(1), 1)?,
            Kind::Differentials | Kind::BiasedDifferentials => {
                check_finite(operation, "differentials", inputs.data(1), 2 * K)?;
                if self.kind == Kind::BiasedDifferentials {
                    check_finite(operation, "biases", inputs.data(2), 1)?;
                }
            }
        }
        if K == 3 {
            let zero = |direction: &[T; K]| direction.iter().all(|&d| d == T::ZERO);
            if let Some(row) = coordinates.as_chunks::<K>().0.iter().position(zero) {
                return Err(RenderError::Direction { operation, row });
            }
        }
        Ok(())
    }

    /// Where the samples are taken, from the inputs before the levels.
    fn lookup<'a, T: Scalar>(
        &self,
        input: impl Fn(usize) -> &'a [T],
        extents: &'a [Extents<T>],
    ) -> Lookup<'a, T, C, K> {
        let mut lookup = Lookup {
            chart: self.chart,
            filter: self.filter,
            coordinates: input(0).as_chunks().0,
            level: None,
            differentials: None,
            bias: None,
            known: None,
            extents,
        };
        match self.kind {
            Kind::Finest => {}
            Kind::Level => lookup.level = Some(input(1)),
            Kind::Differentials | Kind::BiasedDifferentials => {
                lookup.differentials = Some(input(1).as_chunks::<2>().0.as_chunks().0);
                if self.kind == Kind::BiasedDifferentials {
                    lookup.bias = Some(input(2));
                }
            }
        }
        lookup
    }

    /// The extents of all levels, which are the last of `inputs` inputs, and the channels of a texel.
    fn extents<'a, T: Scalar>(
        &self,
        inputs: usize,
        shape: impl Fn(usize) -> &'a Shape,
    ) -> (AllExtents<T>, usize) {
        let first = self.kind.first_level();
        let extents_of = |i: usize| {
            let &[.., rows, columns, channels] = &**shape(i) else {
                unreachable!("it was checked")
            };
            ([rows, columns], channels)
        };
        let extents = (first..inputs).map(|i| Extents::new(extents_of(i).0)).collect();
        (extents, extents_of(first).1)
    }

    /// Which inputs before the levels get a gradient now.
    fn wanted<T: Scalar>(&self, gradients: &Accumulators<'_, T>) -> Wanted {
        let mixes = self.filter.mixes_levels();
        let input_if = |is_there: bool, input: usize| {
            (mixes && is_there && gradients.needs(input)).then_some(input)
        };
        let has_differentials =
            matches!(self.kind, Kind::Differentials | Kind::BiasedDifferentials);
        Wanted {
            coordinates: gradients.needs(0).then_some(0),
            differentials: input_if(has_differentials, 1),
            level: match self.kind {
                Kind::Level => input_if(true, 1),
                Kind::BiasedDifferentials => input_if(true, 2),
                _ => None,
            },
        }
    }

    /// Whether something beside the texels gets a gradient, as `needs` says of inputs: not what
    /// samples are step functions of.
    fn moves(&self, needs: impl Fn(usize) -> bool) -> bool {
        match self.filter {
            TextureFilter::Nearest => false,
            TextureFilter::Bilinear => needs(0),
            _ => (0..self.kind.first_level()).any(needs),
        }
    }
}

impl<T: Scalar, C: Chart<K>, const K: usize> Op<T> for Sample<C, K> {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        C::OPERATION
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Saved<T>,
    ) -> Result<(), RenderError> {
        let count = self.check_shapes(inputs)?;
        self.check_numbers(inputs)?;
        let (extents, channels) = self.extents(inputs.len(), |i| inputs.shape(i));
        let mut lookup = self.lookup(|i| inputs.data(i), &extents);
        saved.levels.clear();
        if self.kind != Kind::Finest && inputs.any_needs() {
            saved.levels.resize(count, T::ZERO);
            for_each_piece_mut(&mut saved.levels, SAMPLES_PER_PIECE, |piece, levels| {
                dispatch_256::<T, _>(
                    #[inline(always)]
                    || {
                        // Moved, so that the closure can run only once and is inlined here.
                        let (first, levels) = (piece * SAMPLES_PER_PIECE, levels);
                        lookup.find_levels(first..first + levels.len(), levels);
                    },
                );
            });
            lookup.known = Some(&saved.levels);
        }
        let out = outputs.try_push(C::OPERATION, [count, channels])?;
        let texels = |level: usize| inputs.data(self.kind.first_level() + level);
        let levels = levels(&extents, texels, channels);
        let values = Values { lookup, levels: &levels };
        match channels {
            3 => write::<T, C, K, 3, 4>(values, channels, out),
            _ if channels % 4 == 0 => write::<T, C, K, 4, 4>(values, channels, out),
            _ => write::<T, C, K, 1, 1>(values, channels, out),
        }
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let first = self.kind.first_level();
        let mut keep = (0..first).fold(Keep::NOTHING, Keep::input);
        if self.moves(|i| inputs.needs(i)) {
            keep = (first..inputs.len()).fold(keep, Keep::input);
        }
        keep
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Saved<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let (first, count) = (self.kind.first_level(), kept.input_shape(0)[0]);
        let bars = kept.only_upstream();
        let moves = self.moves(|i| gradients.needs(i));
        let (extents, channels) = self.extents(kept.input_count(), |i| kept.input_shape(i));
        let mut lookup = self.lookup(|i| kept.input(i), &extents);
        lookup.known = (!saved.levels.is_empty()).then_some(&saved.levels);
        if moves {
            let levels = levels(&extents, |level| kept.input(first + level), channels);
            let values = Values { lookup, levels: &levels };
            let (wanted, from) = (self.wanted(gradients), (count, bars));
            match channels {
                3 => add_moves::<T, C, K, 3, 4>(values, wanted, from, &mut saved.moves, gradients),
                _ if channels % 4 == 0 => {
                    add_moves::<T, C, K, 4, 4>(values, wanted, from, &mut saved.moves, gradients)
                }
                _ => add_moves::<T, C, K, 1, 1>(values, wanted, from, &mut saved.moves, gradients),
            }
        }
        let wanted: SmallVec<[bool; 16]> =
            (first..kept.input_count()).map(|i| gradients.needs(i)).collect();
        if !wanted.contains(&true) {
            return;
        }
        saved.texels.runs.find(&lookup, count, channels, |level| wanted[level]);
        for level in 0..wanted.len() {
            let Some(level_bar) = gradients.get(first + level) else { continue };
            saved.texels.add_level(&Terms { lookup, level, bars, channels }, level_bar.entries());
        }
    }

    fn saved_bytes(&self, saved: &Saved<T>) -> usize {
        size_of_val(saved.levels.as_slice())
            + saved.texels.bytes()
            + size_of_val(saved.moves.as_slice())
    }
}

/// The samples' levels, and memory of the backward pass.
#[derive(Debug)]
struct Saved<T: Scalar> {
    /// Of each sample, before it is bounded; empty where all samples are of the finest level.
    levels: Vec<T>,
    texels: TexelSums<T>,
    /// Gradients of coordinates, differentials and levels, sample by sample.
    moves: Vec<T>,
}

impl<T: Scalar> Default for Saved<T> {
    fn default() -> Self {
        Self { levels: Vec::new(), texels: TexelSums::default(), moves: Vec::new() }
    }
}

/// The texels of all levels.
fn levels<'a, T: Scalar>(
    extents: &[Extents<T>],
    texels: impl Fn(usize) -> &'a [T],
    channels: usize,
) -> SmallVec<[Level<'a, T>; 16]> {
    let levels = extents.iter().enumerate();
    levels.map(|(k, extents)| Level::new(texels(k), channels, *extents)).collect()
}

/// Writes all samples: groups of `N` channels, in `L` numbers each.
fn write<T: Scalar, C: Chart<K>, const K: usize, const N: usize, const L: usize>(
    values: Values<'_, T, C, K>,
    channels: usize,
    out: &mut [T],
) {
    for_each_piece_mut(out, SAMPLES_PER_PIECE * channels, |piece, out| {
        let first = piece * SAMPLES_PER_PIECE;
        dispatch_special::<T, _, _>(
            (first..first + out.len() / channels, out),
            #[inline(always)]
            |(samples, out)| values.write::<N, L>(samples, out),
            |(samples, out)| write_by_channel(values, samples, out),
        );
    });
}

/// Writes samples channel by channel.
#[inline(never)]
fn write_by_channel<T: Scalar, C: Chart<K>, const K: usize>(
    values: Values<'_, T, C, K>,
    samples: Range<usize>,
    out: &mut [T],
) {
    values.write::<1, 1>(samples, out);
}
