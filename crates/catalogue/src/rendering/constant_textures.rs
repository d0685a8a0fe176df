//! Textures and cube maps that outlive a step.

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{CubeMap, Detail, Sampler, Texture, sample_cube_map, sample_texture};
use proptest::prelude::*;

use crate::entry::Entry;
use crate::inputs::leaf;
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("constant_textures");
    // Between two levels: at a level a sample has a kink.
    let inputs = (tensor([3], number()), 0.1..0.9_f64, any::<bool>());
    let cases = inputs.prop_map(|(tint, level, is_coarser)| {
        let level = Tensor::scalar(level + f64::from(u8::from(is_coarser)));
        Case::new(OfConstantTextures, [tint, level].map(Input::leaf))
    });
    entry.check(Check::from_cases("constant textures", cases).refuses_midway(
        "sample_texture needs levels of shape [5], or a single number, got shape [2]",
        Case::new(OfConstantTextures, [leaf([3], 0.5), leaf([2], 0.5)]),
    ));
    entry
}

#[derive(Debug, Clone, Copy)]
struct OfConstantTextures;

impl Subject for OfConstantTextures {
    /// A tint, and the level of all samples.
    fn apply<'t, T: Scalar>(&self, tape: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let elsewhere = Tape::new();
        let texels = |shape: &[usize]| {
            elsewhere.leaf(&Tensor::from_flat_fn(shape, |k| T::from_f64(motley(k))))
        };
        let texture = Texture::with_mipmaps_to(texels(&[9, 12, 3]), 2)?.constant().on(tape);
        let map = CubeMap::with_mipmaps_to(texels(&[6, 8, 8, 3]), 2)?.constant().on(tape);
        let places = |width| Tensor::from_flat_fn([5, width], |k| T::from_f64(motley(k + 7)));
        let detail = Detail::Level(inputs[1]);
        let sampler = Sampler::new();
        let flat = sample_texture(&texture, tape.constant(&places(2)), detail, sampler)?;
        let round = sample_cube_map(&map, tape.constant(&places(3)), detail, sampler)?;
        Ok(vec![flat * inputs[0], round].into())
    }
}
