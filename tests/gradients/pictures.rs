//! Depth, and pictures before every background, with their losses, and blurred.

use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Blur, Border, Fragments, Kernel, Mesh, PixelLoss, Radius, Reference, RenderError,
    Size, antialias, composite, depth, interpolate, rasterize,
};
use proptest::prelude::*;

use crate::blends::choices;
use crate::rendering::{check, leaf, wide};
use crate::scenes::{Scene, scenes, size};

#[derive(Debug)]
struct Depth {
    scene: Scene,
}

impl Subject for Depth {
    /// Clip positions.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let fragments = rasterize(inputs[0], &self.scene.mesh, self.scene.size)?;
        let depth = depth(&fragments)?;
        Ok(Outcome::from(depth).with_state(fragments.coverage.triangle_ids()))
    }
}

#[test]
fn depth_of_fragments() {
    for (kind, scenes) in scenes() {
        let cases = scenes.prop_map(|scene| {
            let clip = Input::leaf(scene.clip.clone());
            Case::new(Depth { scene }, [clip])
        });
        check(
            Check::of_cases(format!("depth, {kind}"), cases)
                .refuses("another number of vertices", of_one_face(leaf([2, 4], 1.0))),
        );
    }
}

/// The depth of one face with positions `clip`.
fn of_one_face(clip: Input) -> Case {
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let scene = Scene { mesh, clip: Tensor::zeros([3, 4]), size: size(4, 4) };
    Case::new(Depth { scene }, [clip])
}

#[derive(Debug)]
struct Pictures {
    scene: Scene,
    /// 0: zeros, 1: the third input, a colour, 2: the third input, an image.
    background: usize,
}

impl Subject for Pictures {
    /// Clip positions, attributes, and perhaps a background.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let size = self.scene.size;
        let fragments = rasterize(inputs[0], &self.scene.mesh, size)?;
        let choices = choices(&fragments, &wide(inputs[0]));
        let background = match self.background {
            0 => Background::Zero,
            1 => Background::Color(inputs[2]),
            _ => Background::Image(inputs[2]),
        };
        let surface = interpolate(inputs[1], &fragments)?;
        let picture = antialias(composite(surface, &fragments, background)?)?;
        assert!(!matches!(picture.background(), Background::Zero) && picture.size() == size);
        let goal = |k: usize| T::from_f64((k * 13 % 29) as f64 / 29.0);
        let goal = Tensor::from_flat_fn([size.height, size.width, picture.channels()], goal);
        let black = Tensor::zeros([2]);
        let error = picture.squared_error(&Reference::new(&goal, &black)?)?;
        let robust = PixelLoss::new(&goal, &black, |seen, goal| {
            Ok((seen.try_sub(goal)?.square() + T::from_f64(0.1)).sqrt())
        })?;
        let robust = picture.map(|seen| Ok(seen.square() + seen))?.loss(&robust)?;
        let (ids, pixels) =
            (fragments.coverage.triangle_ids(), picture.pixels().collect::<Vec<_>>());
        let outputs = vec![picture.image()?, picture.values(), error, robust];
        Ok(Outcome::from(outputs).with_state(ids).with_state(pixels).with_state(choices))
    }
}

#[test]
fn pictures_before_nothing() {
    check_pictures(0);
}

#[test]
fn pictures_before_a_color() {
    check_pictures(1);
}

#[test]
fn pictures_before_an_image() {
    check_pictures(2);
}

fn check_pictures(background: usize) {
    for (kind, scenes) in scenes() {
        let cases = scenes.clone().prop_map(move |scene| in_pictures(scene, background));
        // Of four bands: the sums of two are the same in either order.
        let large = scenes.prop_map(move |scene| {
            in_pictures(Scene { size: size(190, 300), ..scene }, background)
        });
        let name = format!("picture {background}, {kind}");
        check(Check::of_cases(name, cases).large(1, large));
    }
}

/// A scene before a background: see [`Pictures`].
fn in_pictures(scene: Scene, background: usize) -> Case {
    let (vertices, size) = (scene.mesh.vertex_count(), scene.size);
    let motley = |k: usize| (k * 37 % 101) as f64 / 101.0;
    let mut inputs = vec![scene.clip.clone(), Tensor::from_flat_fn([vertices, 2], motley)];
    match background {
        0 => {}
        1 => inputs.push(Tensor::from_flat_fn([2], motley)),
        _ => inputs.push(Tensor::from_flat_fn([size.height, size.width, 2], motley)),
    }
    let inputs: Vec<_> = inputs.into_iter().map(Input::leaf).collect();
    Case::new(Pictures { scene, background }, inputs)
}

/// A picture of two faces, the second before the first.
#[derive(Debug)]
struct BlurredPicture {
    size: Size,
    blur: Blur,
    /// Whether its squared error is meant.
    is_error: bool,
}

/// The fragments of the faces. Positions are the same numbers in every precision.
fn two_faces<T: Scalar>(tape: &Tape<T>, size: Size) -> Result<Fragments<'_, T>, RenderError> {
    let corners = [[-115, -103], [89, -77], [-13, 121], [117, 91], [-39, 13], [25, -89]];
    let place = |k: usize| match (k / 4, k % 4) {
        (corner, axis @ (0 | 1)) => f64::from(corners[corner][axis]) / 128.0,
        (corner, 2) => [0.25, 0.125][corner / 3],
        _ => 1.0,
    };
    let clip = tape.constant(&Tensor::from_flat_fn([6, 4], |k| T::from_f64(place(k))));
    rasterize(clip, &Mesh::new(vec![[0, 1, 2], [3, 4, 5]], 6)?, size)
}

impl Subject for BlurredPicture {
    /// Values at fragments, and a sigma.
    fn apply<'t, T: Scalar>(
        &self,
        tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let fragments = two_faces(tape, self.size)?;
        let picture = antialias(composite(inputs[0], &fragments, Background::Zero)?)?;
        if !self.is_error {
            return Ok(picture.blurred(inputs[1], &self.blur)?.into());
        }
        let Size { width, height } = self.size;
        let goal = |k: usize| T::from_f64((k * 13 % 29) as f64 / 29.0);
        let goal = Tensor::from_flat_fn([height, width, 2], goal);
        Ok(picture.blurred_squared_error(inputs[1], &self.blur, &goal)?.into())
    }
}

/// A picture blurred by a window of a fixed size, so that no tap comes or goes.
fn in_blur(size: Size, (kernel, border): (Kernel, Border), is_error: bool, sigma: f64) -> Case {
    let count = two_faces(&Tape::<f64>::new(), size).unwrap().coverage.count();
    let values = Tensor::from_flat_fn([count, 2], |k| (k * 37 % 101) as f64 / 101.0);
    let blur = Blur { kernel, border, radius: Radius::Fixed(3) };
    let inputs = [values, Tensor::scalar(sigma)].map(Input::leaf);
    Case::new(BlurredPicture { size, blur, is_error }, inputs)
}

#[test]
fn pictures_blurred_by_a_sigma() {
    check_blurred(false);
}

#[test]
fn squared_errors_of_pictures_blurred_by_a_sigma() {
    check_blurred(true);
}

fn check_blurred(is_error: bool) {
    for way in [(Kernel::Sampled, Border::Zero), (Kernel::Discrete, Border::Mirror)] {
        let cases = (1..9_usize, 1..9_usize, 0.4..2.0).prop_map(move |(width, height, sigma)| {
            in_blur(size(width, height), way, is_error, sigma)
        });
        let large = Just(()).prop_map(move |()| in_blur(size(190, 300), way, is_error, 1.3));
        check(Check::of_cases(format!("blurred picture, {way:?}"), cases).large(1, large));
    }
}
