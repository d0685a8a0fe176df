//! The operation that lights surfaces.

use std::sync::atomic::{AtomicBool, Ordering};

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{
    Accumulator, Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Shape, TensorError, Var,
};
use smallvec::SmallVec;

use super::blocks::{
    BLOCK, Column, MATERIAL, MOST_PARTS, PIECE, Rows, Target, Written, for_each_piece,
};
use super::lamp::Kind;
use super::layout::{Layout, NAME};
use super::light::{Light, Surface};
use super::lighting::{Lighting, SUMS_OF_LIGHT};
use super::material::Material;
use super::matte::{BlinnPhong, Lambert, Phong};
use super::metallic_roughness::MetallicRoughness;
use super::model::Model;
use crate::dispatch::{dispatch_256, dispatch_special};
use crate::error::RenderError;

/// The radiance that reaches the eye from `surface`, made of `material`, in the light of `lights`:
/// `[N, 3]`. Without lights it is black.
///
/// Gradients go to all variables of surface, material and lights. Normals and views are normalized, so
/// interpolated ones will do. A light behind the surface adds nothing. An eye behind the surface sees it
/// as from the side.
///
/// On one thread and in `f32` it costs some 15 ns per row, and 20 ns with all gradients on top, for a metal in
/// one light; each further light costs 6 ns each way. A material that conserves energy costs a third more.
///
/// # Errors
/// - [`RenderError::Shape`] unless normals are `[N, 3]`, and all others as their type says.
/// - [`RenderError::Direction`] for a normal or a view of length 0.
/// - [`RenderError::NotFinite`] for a number of a surface or a material that is infinite or NaN, and for
///   a point light so close to a position that the inverse square of the distance is.
/// - `TensorError::Value` for a light with a number that is infinite or NaN, with a direction of length
///   0, or with a negative strength.
/// - `TensorError::Inputs` for a point light without positions.
/// - `TensorError::ForeignVariable` for variables of several tapes.
#[inline(never)]
pub fn shade<'t, T: Scalar>(
    surface: &Surface<'t, T>,
    material: &Material<'t, T>,
    lights: &[Light<'t, T>],
) -> Result<Var<'t, T>, RenderError> {
    let mut kinds = SmallVec::new();
    let mut variables: Variables<'t, T> = SmallVec::new();
    for light in lights {
        match *light {
            Light::Directional { direction, irradiance } => {
                kinds.push(Kind::Directional);
                variables.extend([direction, irradiance]);
            }
            Light::Point { position, intensity } => {
                kinds.push(Kind::Point);
                variables.extend([position, intensity]);
            }
            Light::Ambient { radiance } => {
                kinds.push(Kind::Everywhere { below: true, above: true });
                variables.push(radiance);
            }
        }
    }
    lit(surface, material, kinds, &variables)
}

/// The share of light from everywhere that reaches the eye from below `surface`: `[N, 3]`.
///
/// # Errors
/// As [`shade`].
pub(crate) fn share_below<'t, T: Scalar>(
    surface: &Surface<'t, T>,
    material: &Material<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    share(surface, material, Kind::Everywhere { below: true, above: false })
}

/// The share of light from everywhere that reaches the eye from `surface` itself: `[N, 3]`.
///
/// # Errors
/// As [`shade`].
pub(crate) fn share_above<'t, T: Scalar>(
    surface: &Surface<'t, T>,
    material: &Material<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    share(surface, material, Kind::Everywhere { below: false, above: true })
}

fn share<'t, T: Scalar>(
    surface: &Surface<'t, T>,
    material: &Material<'t, T>,
    kind: Kind,
) -> Result<Var<'t, T>, RenderError> {
    let one = surface.normals.tape().constant_full([3], T::ONE);
    lit(surface, material, SmallVec::from_elem(kind, 1), &[one])
}

/// Variables of a call.
type Variables<'t, T> = SmallVec<[Var<'t, T>; 16]>;

/// What reaches the eye of lights of such kinds, whose variables are `lights`.
///
/// # Errors
/// As [`shade`].
fn lit<'t, T: Scalar>(
    surface: &Surface<'t, T>,
    material: &Material<'t, T>,
    kinds: SmallVec<[Kind; 8]>,
    lights: &[Var<'t, T>],
) -> Result<Var<'t, T>, RenderError> {
    match *material {
        Material::MetallicRoughness { base_color, roughness, metallic, conserves_energy } => {
            let parts = [base_color, roughness, metallic];
            if conserves_energy {
                record(MetallicRoughness::<true>, surface, &parts, kinds, lights)
            } else {
                record(MetallicRoughness::<false>, surface, &parts, kinds, lights)
            }
        }
        Material::Lambert { color } => record(Lambert, surface, &[color], kinds, lights),
        Material::Phong { color, specular, exponent } => {
            record(Phong, surface, &[color, specular, exponent], kinds, lights)
        }
        Material::BlinnPhong { color, specular, exponent } => {
            record(BlinnPhong, surface, &[color, specular, exponent], kinds, lights)
        }
    }
}

fn record<'t, T: Scalar, M: Model<K>, const K: usize>(
    model: M,
    surface: &Surface<'t, T>,
    material: &[Var<'t, T>],
    kinds: SmallVec<[Kind; 8]>,
    lights: &[Var<'t, T>],
) -> Result<Var<'t, T>, RenderError> {
    let layout = Layout { material: M::PARTS, kinds };
    let mut inputs: Variables<'t, T> = SmallVec::from_slice(&[surface.normals, surface.views]);
    if layout.has_points() {
        let Some(positions) = surface.positions else {
            let rule = "positions of the surface in the light of a point".into();
            return Err(TensorError::Inputs { operation: NAME, rule, given: 2 }.into());
        };
        inputs.push(positions);
    }
    inputs.extend_from_slice(material);
    inputs.extend_from_slice(lights);
    surface.normals.tape().apply(Shade { model, layout }, &inputs)
}

/// Inputs: as the layout says. Output: `[N, 3]`.
struct Shade<M, const K: usize> {
    model: M,
    layout: Layout,
}

/// Memory of a backward pass: sums of each piece.
#[derive(Debug)]
struct Saved<T: Scalar>(Vec<T::Wide>);

impl<T: Scalar> Default for Saved<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Scalar, M: Model<K>, const K: usize> Op<T> for Shade<M, K> {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut Saved<T>,
    ) -> Result<(), RenderError> {
        let count = self.layout.check(inputs)?;
        let lighting = self.lighting(count, |i| inputs.shape(i), |i| inputs.data(i));
        let is_refused = AtomicBool::new(false);
        for_each_piece_mut(outputs.push([count, 3]), 3 * PIECE, |piece, out| {
            let is_good = dispatch_256::<T, _>(
                #[inline(always)]
                || {
                    // Moved, so that the closure can run only once and is inlined here.
                    let out = out;
                    let blocks = out.chunks_mut(3 * BLOCK).zip((piece * PIECE..).step_by(BLOCK));
                    let light = |(out, start): (&mut [T], usize)| {
                        lighting.light(start..start + out.len() / 3, out)
                    };
                    blocks.map(light).fold(true, |all, is_good| all & is_good)
                },
            );
            if !is_good {
                is_refused.store(true, Ordering::Relaxed);
            }
        });
        if is_refused.into_inner() {
            return Err(self.layout.refuse(&lighting.rows, &lighting.lamps));
        }
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        (0..inputs.len()).fold(Keep::NOTHING, Keep::input)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        Saved(sums): &mut Saved<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let count = kept.input_shape(0)[0];
        let lighting = &self.lighting(count, |i| kept.input_shape(i), |i| kept.input(i));
        let rows = &lighting.rows;
        let has_sums = self.has_sums(rows, gradients);
        let width = if has_sums { MATERIAL + K + SUMS_OF_LIGHT * lighting.lamps.len() } else { 0 };
        sums.clear();
        // Without rows there is a piece without any, whose sums are zeros.
        sums.resize(count.div_ceil(PIECE).max(1) * width, T::Wide::ZERO);

        // Gradients of rows are written at the same time, and so taken out for as long.
        let mut taken: SmallVec<[(usize, Accumulator<T>); MOST_PARTS]> = SmallVec::new();
        let mut places: SmallVec<[&Column<'_, T>; MOST_PARTS]> = SmallVec::new();
        for (input, column) in
            rows.columns.iter().enumerate().filter(|(_, column)| !column.is_uniform)
        {
            if let Some(gradient) = gradients.take(input) {
                taken.push((input, gradient));
                places.push(column);
            }
        }
        let targets = taken.iter_mut().zip(&places).map(|((_, gradient), column)| {
            let (entries, is_fresh) = gradient.entries_or_fresh();
            Target { first: column.first, width: column.width, entries, is_fresh }
        });
        let written = Written { targets: targets.collect(), sums, width };
        let upstream =
            &Column { entries: kept.only_upstream(), first: 0, width: 3, is_uniform: false };
        let has_geometry = self.has_geometry(gradients);
        for_each_piece(0..count, written, &|rows, mut written| {
            // Where there are no vectors, all gradients are found, whether they are wanted or not.
            if has_geometry {
                dispatch_special::<T, _, _>(
                    (rows, &mut written),
                    #[inline(always)]
                    |(rows, written)| lighting.pull_back::<K, true>(upstream, rows, written),
                    |(rows, written)| lighting.pull_back_all(upstream, rows, written),
                );
            } else {
                dispatch_special::<T, _, _>(
                    (rows, &mut written),
                    #[inline(always)]
                    |(rows, written)| lighting.pull_back::<K, false>(upstream, rows, written),
                    |(rows, written)| lighting.pull_back_all(upstream, rows, written),
                );
            }
        });
        for (input, gradient) in taken {
            gradients.put_back(input, gradient);
        }
        if has_sums {
            self.add_sums(lighting, sums, gradients);
        }
    }
}

impl<M: Model<K>, const K: usize> Shade<M, K> {
    /// Surface, material and lights, of which input i has such a shape and such entries.
    fn lighting<'a, T: Scalar>(
        &self,
        count: usize,
        shape: impl Fn(usize) -> &'a Shape,
        data: impl Fn(usize) -> &'a [T],
    ) -> Lighting<'a, T, M> {
        let lamps = self.layout.lamps(&data);
        Lighting { model: self.model, rows: self.layout.rows(count, shape, data), lamps }
    }

    /// Whether a gradient of a direction or a position is wanted.
    fn has_geometry<T: Scalar>(&self, gradients: &Accumulators<'_, T>) -> bool {
        let of_rows = self.layout.parts().into_iter().filter(|part| part.first < MATERIAL);
        let of_lights = self.layout.lights().filter_map(|light| light.place);
        of_rows.map(|part| part.input).chain(of_lights).any(|input| gradients.needs(input))
    }

    /// Whether a gradient is wanted that is a sum over rows.
    fn has_sums<T: Scalar>(&self, rows: &Rows<'_, T>, gradients: &Accumulators<'_, T>) -> bool {
        let mut columns = rows.columns.iter().enumerate();
        let mut lights = self.layout.lights();
        columns.any(|(input, column)| column.is_uniform && gradients.needs(input))
            || lights.any(|light| {
                let mut inputs = light.place.into_iter().chain([light.strength]);
                inputs.any(|input| gradients.needs(input))
            })
    }

    /// Adds the sums of all pieces, in their order, to the gradients that they are.
    fn add_sums<T: Scalar>(
        &self,
        Lighting { rows, lamps, .. }: &Lighting<'_, T, M>,
        sums: &mut [T::Wide],
        gradients: &mut Accumulators<'_, T>,
    ) {
        // The sums of the first piece become the totals.
        let (totals, pieces) = sums.split_at_mut(MATERIAL + K + SUMS_OF_LIGHT * lamps.len());
        for piece in pieces.chunks_exact(totals.len()) {
            totals.iter_mut().zip(piece).for_each(|(total, &sum)| *total += sum);
        }
        for (input, column) in
            rows.columns.iter().enumerate().filter(|(_, column)| column.is_uniform)
        {
            if let Some(bar) = gradients.get(input) {
                bar.add_each(|k| T::narrow(totals[column.first + k]));
            }
        }
        let (of_lights, _) = totals[MATERIAL + K..].as_chunks::<SUMS_OF_LIGHT>();
        for ((light, lamp), &[x, y, z, strength @ ..]) in
            self.layout.lights().zip(lamps).zip(of_lights)
        {
            if let Some(bar) = light.place.and_then(|input| gradients.get(input)) {
                let place_bar = lamp.pull_back_place([x, y, z]);
                bar.add_each(|k| T::narrow(place_bar[k]));
            }
            if let Some(bar) = gradients.get(light.strength) {
                bar.add_each(|k| T::narrow(strength[k]));
            }
        }
    }
}
