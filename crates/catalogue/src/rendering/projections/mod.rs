//! Projections by intrinsics: `pinhole` and `orthographic`.

mod extremes;

use bokashi_check::strategy::{non_zero, number};
use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Size, orthographic, pinhole};
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::scenes::size;

/// Intrinsics of an image.
const PIXELS: [f64; 4] = [300.0, 280.0, 127.5, 120.25];

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("projections").with_extremes(extremes::EXTREMES);
    for (is_pinhole, planes) in [
        (true, vec![(0.1, 10.0), (1e-3, 1e3), (0.5, f64::INFINITY)]),
        (false, vec![(0.1, 10.0), (-2.0, 3.0)]),
    ] {
        let of = move |(near, far): (f64, f64), tensor| {
            let projection = Projection { is_pinhole, size: size(7, 5), near, far };
            Case::new(projection, [Input::leaf(tensor)])
        };
        let cases =
            (select(planes), intrinsics()).prop_map(move |(planes, of_it)| of(planes, of_it));
        let name = if is_pinhole { "pinhole" } else { "orthographic" };
        let refused = if is_pinhole { refused_by_pinhole() } else { refused_by_orthographic() };
        let (three, message) =
            (Tensor::full([3], 5.0), "needs intrinsics of shape [4], got shape [3]");
        let check = Check::from_cases(name, cases);
        let check = check.refuses(format!("{name} {message}"), of((0.1, 1.0), three));
        entry.check(refused.into_iter().fold(check, |check, (message, projection, intrinsics)| {
            let case = Case::new(projection, [Input::leaf(Tensor::from(intrinsics))]);
            check.refuses(message, case)
        }));
    }
    benchmark!(entry, "pinhole", |s| [Tensor::from(PIXELS)], |x| pinhole(
        x[0], s.size, 0.1, 100.0
    )?);
    benchmark!(entry, "orthographic", |s| [Tensor::from(PIXELS)], |x| {
        orthographic(x[0], s.size, 0.1, 100.0)?
    });
    entry
}

#[derive(Debug, Clone, Copy)]
struct Projection {
    is_pinhole: bool,
    size: Size,
    near: f64,
    far: f64,
}

impl Subject for Projection {
    /// Intrinsics.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let &Self { size, near, far, .. } = self;
        Ok(match self.is_pinhole {
            true => pinhole(inputs[0], size, near, far)?.into(),
            false => orthographic(inputs[0], size, near, far)?.into(),
        })
    }
}

/// Four numbers from 0.1 up in size, as intrinsics.
fn intrinsics() -> impl Strategy<Value = Tensor<f64>> {
    [non_zero(), non_zero(), number(), number()].prop_map(Tensor::from)
}

type Refused = Vec<(&'static str, Projection, [f64; 4])>;

const RIGHT: [f64; 4] = [5.0, 5.0, 3.0, 2.0];

fn refused_by_pinhole() -> Refused {
    let sized = |size, near, far| Projection { is_pinhole: true, size, near, far };
    let between = |near, far| sized(size(7, 5), near, far);
    let right = between(0.1, 1.0);
    vec![
        ("pinhole needs a finite focal length other than 0, got 0", right, [5.0, 0.0, 0.0, 0.0]),
        (
            "pinhole needs a finite focal length other than 0, got inf",
            right,
            [f64::INFINITY, 5.0, 0.0, 0.0],
        ),
        ("pinhole needs a finite principal point, got NaN", right, [5.0, 5.0, 0.0, f64::NAN]),
        (
            "an image needs at least one pixel and fewer than 2^32 - 1, got 0 x 0",
            sized(size(0, 0), 0.1, 1.0),
            RIGHT,
        ),
        (
            "pinhole needs a near plane at a finite distance above 0, got 0",
            between(0.0, 1.0),
            RIGHT,
        ),
        (
            "pinhole needs a near plane at a finite distance above 0, got inf",
            between(f64::INFINITY, f64::INFINITY),
            RIGHT,
        ),
        (
            "pinhole needs a far plane beyond the near plane at 0.5, got 0.5",
            between(0.5, 0.5),
            RIGHT,
        ),
        (
            "pinhole needs a far plane beyond the near plane at 0.5, got NaN",
            between(0.5, f64::NAN),
            RIGHT,
        ),
        (
            "a camera matrix needs finite entries, got inf in row 0, column 0",
            sized(size(1, 1), 0.1, 1.0),
            [1e308, 5.0, 0.0, 0.0],
        ),
    ]
}

fn refused_by_orthographic() -> Refused {
    let between = |near, far| Projection { is_pinhole: false, size: size(7, 5), near, far };
    let right = between(0.1, 1.0);
    vec![
        ("orthographic needs a finite scale other than 0, got 0", right, [0.0, 1.0, 0.0, 0.0]),
        ("orthographic needs a finite centre, got inf", right, [1.0, 1.0, f64::INFINITY, 0.0]),
        (
            "orthographic needs a finite near plane, got -inf",
            between(f64::NEG_INFINITY, 1.0),
            RIGHT,
        ),
        (
            "orthographic needs a finite far plane beyond the near plane at 2, got -1",
            between(2.0, -1.0),
            RIGHT,
        ),
        (
            "orthographic needs a finite far plane beyond the near plane at 2, got inf",
            between(2.0, f64::INFINITY),
            RIGHT,
        ),
    ]
}
