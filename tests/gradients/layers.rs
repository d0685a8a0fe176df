//! Layers in depth, images over images, and sums over parts.

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject, subject};
use bokashi_core::{Scalar, Tape, Tensor, TensorError, Var};
use bokashi_render_ops::{
    Background, Layer, Mesh, composite_layers, depth_layers, over, rasterize, rasterize_behind,
};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::rendering::{check, leaf};
use crate::scenes::{Scene, motley, scenes};

#[derive(Debug)]
struct Behind {
    scene: Scene,
}

impl Subject for Behind {
    /// Clip positions.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let front = rasterize(inputs[0], &self.scene.mesh, self.scene.size)?;
        let behind = rasterize_behind(&front, self.scene.size)?;
        let ids = [&front, &behind].map(|layer| layer.coverage.triangle_ids());
        Ok(Outcome::from(behind.barycentrics).with_state(ids))
    }
}

#[test]
fn the_layer_behind_the_first() {
    for (kind, scenes) in scenes() {
        // With all faces again, behind where they are.
        let cases = scenes.prop_map(|scene| {
            let count = scene.mesh.vertex_count();
            let moved = |&[a, b, c]: &[u32; 3]| [a, b, c].map(|vertex| vertex + count as u32);
            let faces = scene.mesh.faces();
            let faces = faces.iter().copied().chain(faces.iter().map(moved)).collect();
            let clip = Tensor::from_fn([2 * count, 4], |[v, k]| {
                let row = v % count;
                let shift = if v >= count && k == 2 { 0.3 * scene.clip[[row, 3]] } else { 0.0 };
                scene.clip[[row, k]] + shift
            });
            let mesh = Mesh::new(faces, 2 * count).unwrap();
            let scene = Scene { mesh, clip: clip.clone(), size: scene.size };
            Case::new(Behind { scene }, [Input::leaf(clip)])
        });
        check(Check::of_cases(format!("rasterize_behind, {kind}"), cases));
    }
}

#[derive(Debug)]
struct Layers {
    scene: Scene,
    /// 0: zeros, 1: a colour, 2: an image.
    background: usize,
}

impl Subject for Layers {
    /// Colours and alphas of all faces, and a background. The geometry stays, so that layers have as many
    /// fragments in any precision.
    fn apply<'t, T: Scalar>(
        &self,
        tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let clip = tape.constant(&self.scene.clip.cast());
        let layers = depth_layers(clip, &self.scene.mesh, self.scene.size, Some(3))?;
        let ids: Vec<_> = layers.iter().map(|layer| layer.coverage.triangle_ids()).collect();
        let mut all = Vec::new();
        for layer in &layers {
            let faces: Vec<u32> = layer.coverage.faces().map(|face| face as u32).collect();
            let rows = faces.into();
            all.push((inputs[0].gather_rows(&rows)?, inputs[1].gather_rows(&rows)?));
        }
        let with = |(fragments, &(premultiplied, alpha))| Layer { fragments, premultiplied, alpha };
        let layers: Vec<_> = layers.iter().zip(&all).map(with).collect();
        let background = match self.background {
            0 => Background::Zero,
            1 => Background::Color(inputs[2]),
            _ => Background::Image(inputs[2]),
        };
        let picture = composite_layers(&layers, background)?;
        Ok(Outcome::from(picture.image()?).with_state(ids))
    }
}

#[test]
fn composite_layers_before_every_background() {
    for (kind, scenes) in scenes() {
        for background in 0..3 {
            let has_layers = |scene: &Scene| {
                let tape = Tape::<f64>::new();
                let seen = rasterize(tape.constant(&scene.clip), &scene.mesh, scene.size);
                seen.unwrap().coverage.count() > 0
            };
            let cases = (scenes.clone().prop_filter("nothing is seen", has_layers), 1..4_usize)
                .prop_map(move |(scene, channels)| {
                    let faces = scene.mesh.faces().len();
                    let mut inputs = vec![
                        Tensor::from_flat_fn([faces, channels], motley),
                        Tensor::from_flat_fn([faces], |k| 0.5 + 0.4 * motley(7 * k)),
                    ];
                    match background {
                        1 => inputs.push(Tensor::from_flat_fn([channels], motley)),
                        2 => {
                            let shape = [scene.size.height, scene.size.width, channels];
                            inputs.push(Tensor::from_flat_fn(shape, motley));
                        }
                        _ => {}
                    }
                    let inputs: Vec<_> = inputs.into_iter().map(Input::leaf).collect();
                    Case::new(Layers { scene, background }, inputs)
                });
            check(Check::of_cases(format!("composite_layers, {kind}, {background}"), cases));
        }
    }
}

#[derive(Debug)]
struct Over;

impl Subject for Over {
    /// Two images.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        Ok(over(inputs[0], inputs[1])?.into())
    }
}

#[test]
fn one_image_over_another() {
    let channels = select(&[1_usize, 2, 4][..]);
    let cases = channels.prop_flat_map(|channels| {
        let shape = (1..5_usize, 1..5_usize).prop_map(move |(h, w)| [h, w, channels]);
        shape.prop_flat_map(|shape| {
            [tensor(shape, number()), tensor(shape, number())]
                .prop_map(|images| Case::new(Over, images.map(Input::leaf)))
        })
    });
    let large = [3, 9].map(|by| Tensor::from_flat_fn([120, 90, 4], |k| motley(by * k)));
    check(
        Check::of_cases("over", cases)
            .large(1, Just(Case::new(Over, large.map(Input::leaf))))
            .refuses(
                "images of two sizes",
                Case::new(Over, [leaf([2, 2, 3], 0.5), leaf([2, 3, 3], 0.5)]),
            ),
    );
}

#[test]
fn sums_over_parts() {
    subject!(SumOver: |x| {
        x[0].tape().sum_over(5, x, |k, _, x| {
            let scaled = x[0].try_mul(x[1])? * T::from_f64(0.3 + k as f64);
            Ok::<_, TensorError>(scaled.sin().sum())
        })?
    });
    let shapes = (1..4_usize).prop_flat_map(|n| {
        vec(tensor([n], number()), 2).prop_map(|x| x.into_iter().map(Input::leaf).collect())
    });
    check(Check::new("sum_over", SumOver, shapes.boxed()).refuses(
        "shapes that don't broadcast",
        Case::new(SumOver, [leaf([2], 0.5), leaf([3], 0.5)]),
    ));
}
