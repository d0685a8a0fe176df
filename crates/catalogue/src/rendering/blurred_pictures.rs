//! Pictures that are blurred, and squared errors of them.

use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Blur, Border, Fragments, Kernel, Mesh, PixelLoss, Radius, RenderError, Size,
    antialias, composite, rasterize,
};
use proptest::prelude::*;

use crate::entry::Entry;
use crate::scenes::size;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("blurred_pictures");
    for is_error in [false, true] {
        in_both_ways(&mut entry, is_error);
    }
    entry
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
    fn apply<'t, T: Scalar>(&self, tape: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let fragments = two_faces(tape, self.size)?;
        let picture = antialias(composite(inputs[0], &fragments, Background::Zero)?)?;
        if !self.is_error {
            return Ok(picture.blurred(inputs[1], &self.blur).image()?.into());
        }
        let Size { width, height } = self.size;
        let goal = |k: usize| T::from_f64((k * 13 % 29) as f64 / 29.0);
        let goal = Tensor::from_flat_fn([height, width, 2], goal);
        let loss = PixelLoss::squared(&goal, &Tensor::zeros([2]))?;
        Ok(picture.blurred(inputs[1], &self.blur).loss(&loss)?.into())
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

fn in_both_ways(entry: &mut Entry, is_error: bool) {
    for way in [(Kernel::Sampled, Border::Zero), (Kernel::Discrete, Border::Mirror)] {
        let cases = (1..9_usize, 1..9_usize, 0.4..2.0).prop_map(move |(width, height, sigma)| {
            in_blur(size(width, height), way, is_error, sigma)
        });
        let large = Just(()).prop_map(move |()| in_blur(size(190, 300), way, is_error, 1.3));
        entry.check(Check::from_cases(format!("blurred picture, {way:?}"), cases).large(1, large));
    }
}
