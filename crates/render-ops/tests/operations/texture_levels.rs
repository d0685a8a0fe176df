//! Laws of the levels of textures: which are made, and that they stay.

use bokashi_core::Tape;
use bokashi_render_ops::{CubeMap, Detail, Sampler, Texture, sample_cube_map, sample_texture};

use crate::texture::{coordinates, differentials, motley};

#[test]
fn levels_that_a_sampler_does_not_use_need_not_be_made() {
    let tape = Tape::<f64>::new();
    let (uv, slopes) = (tape.leaf(&coordinates(200)), tape.leaf(&differentials(200, 2)));
    let texels = tape.leaf(&motley([20, 33, 2], 1));
    let detail = Detail::Differentials { differentials: slopes, bias: None };
    let sampled = |texture: &Texture<'_, f64>, sampler| {
        let out = sample_texture(texture, uv, detail, sampler).unwrap();
        let gradients = out.square().sum().backward().unwrap();
        [out.value(), gradients.get_or_zeros(texels), gradients.get_or_zeros(slopes)]
    };
    let all = Texture::with_mipmaps(texels).unwrap();
    for coarsest in [0, 1, 2, 4, 5, 6, usize::MAX] {
        let few = Texture::with_mipmaps_to(texels, coarsest).unwrap();
        assert_eq!(few.levels().len(), all.levels().len().min(coarsest.saturating_add(1)));
        let sampler = Sampler::new().coarsest(coarsest);
        assert_eq!(sampled(&few, Sampler::new()), sampled(&all, sampler));
        let map = CubeMap::with_mipmaps_to(tape.leaf(&motley([6, 20, 20, 1], 2)), coarsest);
        assert_eq!(map.unwrap().levels().len(), 5.min(coarsest.saturating_add(1)));
    }
    let flat = tape.leaf(&motley([4, 4], 1));
    assert!(
        Texture::with_mipmaps_to(flat, 0).is_err() && CubeMap::with_mipmaps_to(flat, 0).is_err()
    );
}

#[test]
fn constant_textures_are_the_same_on_later_steps_and_other_tapes() {
    let mut tape = Tape::<f64>::new();
    let (constant, constant_map) = {
        let texels =
            [motley([9, 12, 3], 1), motley([6, 9, 9, 3], 2)].map(|texels| tape.leaf(&texels));
        let [texture, map] = texels;
        (
            Texture::with_mipmaps(texture).unwrap().constant(),
            CubeMap::with_mipmaps(map).unwrap().constant(),
        )
    };
    let sampled = |tape: &Tape<f64>| {
        let (texture, map) = (constant.on(tape), constant_map.on(tape));
        assert!(texture.levels().iter().chain(map.levels()).all(|level| !level.needs_gradient()));
        let (uv, towards) = (tape.leaf(&coordinates(50)), tape.leaf(&motley([50, 3], 4)));
        let detail = Detail::Level(tape.leaf_scalar(1.3));
        let flat = sample_texture(&texture, uv, detail, Sampler::new()).unwrap();
        let round = sample_cube_map(&map, towards, detail, Sampler::new()).unwrap();
        let gradients = (flat * round).sum().backward().unwrap();
        [flat.value(), round.value(), gradients.get_or_zeros(uv), gradients.get_or_zeros(towards)]
    };
    assert_eq!((constant.levels().len(), constant_map.levels().len()), (4, 4));
    let expected = sampled(&Tape::new());
    for _ in 0..2 {
        tape.reset();
        // What the step before has left is written over, but for what is still held.
        let other = tape.leaf(&motley([9, 12, 3], 7));
        assert_eq!(Texture::with_mipmaps(other).unwrap().levels().len(), 4);
        assert_eq!(sampled(&tape), expected);
    }
}
