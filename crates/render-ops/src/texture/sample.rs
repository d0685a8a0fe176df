//! The operation that looks textures up.

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Shape, Var, sum};
use smallvec::SmallVec;

use super::cell::Extents;
use super::chart::{Chart, Cube, Plane};
use super::levels::{CubeMap, Texture};
use super::lookup::Lookup;
use super::options::{Detail, MOST_PROBES, Sampler, TextureFilter};
use super::texels::TexelSums;
use super::values::{Level, Values};
use crate::error::RenderError;

/// Samples of a texture at `coordinates: [N, 2]`, in the order (u, v): `[N, C]`.
///
/// (0, 0) is the upper left corner of the texture, whose row 0 is on top, and (1, 1) the lower right
/// corner. Gradients go to the texels of all levels, to the coordinates, and to the level or to the
/// differentials and the bias. A texture of one level needs no detail and looks at none.
///
/// It costs some 10 ns per sample with mipmaps and three channels, and three times as much with all
/// gradients; each probe of an anisotropic filter costs as much.
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
    sample(Plane { border: sampler.border }, &texture.levels, coordinates, detail, sampler)
}

/// Samples of a cube map in `directions: [N, 3]`, of any length but 0: `[N, C]`. Samples go on over the
/// edges of the faces, so no edge is seen.
///
/// Gradients and cost are those of [`sample_texture`]. The sampler's border is not asked for.
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

/// Runs `work` for the widest vectors of the machine.
#[inline(always)]
fn dispatch(work: impl FnOnce()) {
    pulp::Arch::new().dispatch(work);
}

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
    let at = numbers.iter().position(|number| !number.is_finite()).expect("it was found above");
    let value = numbers[at].to_f64();
    Err(RenderError::NotFinite { operation, what, row: at / width.max(1), value })
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
        let of = |i: usize| {
            let &[.., rows, columns, channels] = &**shape(i) else {
                unreachable!("it was checked")
            };
            ([rows, columns], channels)
        };
        let extents = (first..inputs).map(|i| Extents::new(of(i).0)).collect();
        (extents, of(first).1)
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
                dispatch(
                    #[inline(always)]
                    || {
                        for (n, level) in (piece * SAMPLES_PER_PIECE..).zip(levels) {
                            *level = lookup.level(n);
                        }
                    },
                );
            });
            lookup.known = Some(&saved.levels);
        }
        let out = outputs.push([count, channels]);
        let texels = |level: usize| inputs.data(self.kind.first_level() + level);
        match channels {
            3 => write::<T, C, K, 3>(lookup, texels, channels, out),
            4 => write::<T, C, K, 4>(lookup, texels, channels, out),
            _ => write::<T, C, K, 1>(lookup, texels, channels, out),
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
        let Saved { texels, moves: rows, levels } = saved;
        let (extents, channels) = self.extents(kept.input_count(), |i| kept.input_shape(i));
        let mut lookup = self.lookup(|i| kept.input(i), &extents);
        lookup.known = (!levels.is_empty()).then_some(levels);
        if moves {
            let texels = |level: usize| kept.input(first + level);
            let from = Upstream { count, bars, channels };
            match channels {
                3 => self.pull_back::<T, 3>(lookup, texels, from, rows, gradients),
                4 => self.pull_back::<T, 4>(lookup, texels, from, rows, gradients),
                _ => self.pull_back::<T, 1>(lookup, texels, from, rows, gradients),
            }
        }
        let wanted: SmallVec<[bool; 16]> =
            (first..kept.input_count()).map(|i| gradients.needs(i)).collect();
        if !wanted.contains(&true) {
            return;
        }
        let counts = extents.iter().map(|extents| extents.counts);
        texels.sort(&lookup, count, counts, [C::FACES, channels], |level| wanted[level]);
        for level in 0..wanted.len() {
            let Some(level_bar) = gradients.get(first + level) else { continue };
            texels.add_level(self.chart, &lookup, level, bars, channels, level_bar.entries());
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

/// The levels' texels, in groups of `N` channels.
fn levels<'a, T: Scalar, const N: usize>(
    extents: &[Extents<T>],
    texels: impl Fn(usize) -> &'a [T],
    channels: usize,
) -> SmallVec<[Level<'a, T, N>; 16]> {
    let levels = extents.iter().enumerate().map(|(level, &extents)| Level {
        texels: texels(level).as_chunks().0,
        step: channels / N,
        extents,
    });
    levels.collect()
}

/// Writes all samples.
fn write<'a, T: Scalar, C: Chart<K>, const K: usize, const N: usize>(
    lookup: Lookup<'a, T, C, K>,
    texels: impl Fn(usize) -> &'a [T],
    channels: usize,
    out: &mut [T],
) {
    let levels = levels::<T, N>(lookup.extents, texels, channels);
    let values = Values { lookup, levels: &levels };
    for_each_piece_mut(out, SAMPLES_PER_PIECE * channels, |piece, out| {
        let samples = piece * SAMPLES_PER_PIECE..;
        let rows = samples.zip(out.as_chunks_mut().0.chunks_exact_mut(channels / N));
        dispatch(
            #[inline(always)]
            || {
                for (n, out) in rows {
                    values.write(n, out);
                }
            },
        );
    });
}

/// The gradients of all samples.
#[derive(Clone, Copy)]
struct Upstream<'a, T> {
    count: usize,
    bars: &'a [T],
    channels: usize,
}

impl<C: Chart<K>, const K: usize> Sample<C, K> {
    /// Adds the gradients of coordinates, differentials, level and bias.
    fn pull_back<'a, T: Scalar, const N: usize>(
        &self,
        lookup: Lookup<'a, T, C, K>,
        texels: impl Fn(usize) -> &'a [T],
        Upstream { count, bars, channels }: Upstream<'a, T>,
        moves: &mut Vec<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let levels = levels::<T, N>(lookup.extents, texels, channels);
        let values = Values { lookup, levels: &levels };
        let (bars, step) = (bars.as_chunks::<N>().0, channels / N);
        let bias = if self.kind == Kind::Level { 1 } else { 2 };
        let mixes = self.filter.mixes_levels();
        let has_level = matches!(self.kind, Kind::Level | Kind::BiasedDifferentials);
        let wants = [
            gradients.needs(0),
            mixes && bias == 2 && self.kind != Kind::Finest && gradients.needs(1),
            mixes && has_level && gradients.needs(bias),
        ];
        if wants == [true, false, false] {
            let coordinates_bar = gradients.get(0).expect("it is wanted");
            let (entries, is_fresh) = coordinates_bar.entries_or_fresh();
            return for_each_piece_mut(entries, K * SAMPLES_PER_PIECE, |piece, entries| {
                let rows = (piece * SAMPLES_PER_PIECE..).zip(entries.as_chunks_mut::<K>().0);
                dispatch(
                    #[inline(always)]
                    || {
                        for (n, entries) in rows {
                            let bars = &bars[n * step..][..step];
                            let (bar, ..) = values.pull_back(n, bars, false);
                            for (entry, bar) in entries.iter_mut().zip(bar) {
                                *entry = if is_fresh { bar } else { *entry + bar };
                            }
                        }
                    },
                );
            });
        }
        let widths = [K, 2 * K, 1];
        let starts = [0, K, 3 * K];
        let width = 3 * K + 1;
        moves.clear();
        moves.resize(count * width, T::ZERO);
        for_each_piece_mut(moves, width * SAMPLES_PER_PIECE, |piece, moves| {
            let rows = (piece * SAMPLES_PER_PIECE..).zip(moves.chunks_exact_mut(width));
            dispatch(
                #[inline(always)]
                || {
                    for (n, moves) in rows {
                        let bars = &bars[n * step..][..step];
                        let (bar, slopes, level) = values.pull_back(n, bars, wants[1]);
                        moves[..K].copy_from_slice(&bar);
                        moves[K..3 * K].copy_from_slice(slopes.as_flattened());
                        moves[3 * K] = level;
                    }
                },
            );
        });
        for part in (0..3).filter(|&part| wants[part]) {
            let i = [0, 1, bias][part];
            let Some(own_bar) = gradients.get(i) else { continue };
            let (entries, is_fresh) = own_bar.entries_or_fresh();
            let (start, own) = (starts[part], widths[part]);
            if entries.len() != count * own {
                // One number for all samples.
                let total = T::narrow(sum::<T>(count, |n| moves[n * width + start].widen()));
                entries[0] = if is_fresh { total } else { entries[0] + total };
                continue;
            }
            for_each_piece_mut(entries, own * SAMPLES_PER_PIECE, |piece, entries| {
                let moves = moves[piece * SAMPLES_PER_PIECE * width..].chunks_exact(width);
                for (entries, moves) in entries.chunks_exact_mut(own).zip(moves) {
                    for (entry, &bar) in entries.iter_mut().zip(&moves[start..]) {
                        *entry = if is_fresh { bar } else { *entry + bar };
                    }
                }
            });
        }
    }
}
