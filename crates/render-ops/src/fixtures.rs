//! Scenes that the tests of several files look at.

use std::sync::Arc;

use bokashi_core::{Scalar, Tape, Tensor, Var};

use crate::coverage::Coverage;
use crate::fragments::Fragments;
use crate::mesh::Mesh;
use crate::rasterize::rasterize;
use crate::size::Size;

/// The size of `surface`'s image.
pub(crate) const SMALL: Size = Size { width: 5, height: 3 };

/// The fragments of a face over part of an image, and values `[N, 2]` on it.
pub(crate) fn surface<T: Scalar>(tape: &Tape<T>) -> (Fragments<'_, T>, Var<'_, T>) {
    let clip = [-1.2, -0.9, 0.0, 1.0, 0.6, -0.7, 0.0, 1.0, 0.1, 1.3, 0.0, 1.0].map(T::from_f64);
    let clip = tape.leaf(&Tensor::new([3, 4], clip.to_vec()).unwrap());
    let fragments = rasterize(clip, &Mesh::new(vec![[0, 1, 2]], 3).unwrap(), SMALL).unwrap();
    let count = fragments.coverage.count();
    assert!((3..12).contains(&count), "{count}");
    let values = Tensor::from_flat_fn([count, 2], |k| T::from_f64(100.0 + k as f64));
    (fragments, tape.leaf(&values))
}

/// The coverage of a large face and of small ones before it, over several bands.
pub(crate) fn many_faces() -> Arc<Coverage> {
    let mut corners = vec![[-0.7, -0.9, 0.5], [0.9, -0.5, 0.5], [0.1, 0.8, 0.5]];
    for k in 0..40 {
        let (x, y) = (-0.8 + 0.04 * k as f64, 0.7 * (0.9 * k as f64).sin());
        corners.extend([[x, y, 0.0], [x + 0.09, y - 0.03, 0.0], [x + 0.02, y + 0.1, 0.0]]);
    }
    let mesh = Mesh::new((0..41).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(), 123);
    let clip = corners.iter().flat_map(|&[x, y, z]| [x, y, z, 1.0]).collect();
    let tape = Tape::<f64>::new();
    let clip = tape.leaf(&Tensor::new([123, 4], clip).unwrap());
    let fragments = rasterize(clip, &mesh.unwrap(), Size { width: 300, height: 200 }).unwrap();
    Arc::clone(&fragments.coverage)
}

/// Numbers in [-1/2, 1/2] of which no two are alike.
pub(crate) fn number(k: usize) -> f64 {
    ((k * 7919 + 13) % 1009) as f64 / 1009.0 - 0.5
}

/// The positions `[V, 3]` and the faces of a bent sheet of `columns` by `rows` quads.
pub(crate) fn bent_sheet(columns: usize, rows: usize) -> (Vec<f64>, Vec<[u32; 3]>) {
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    for k in 0..(columns + 1) * (rows + 1) {
        let [column, row] = [k % (columns + 1), k / (columns + 1)];
        let [x, y] = [column as f64 / columns as f64, row as f64 / rows as f64];
        let bump = 0.3 * (3.0 * x).sin() * (2.0 * y).cos();
        positions.extend([x - 0.4, y + 0.2, bump].map(|at| at + 0.02 * number(k)));
        if column < columns && row < rows {
            let [below, above] = [k, k + columns + 1].map(|vertex| vertex as u32);
            faces.extend([[below, below + 1, above + 1], [below, above + 1, above]]);
        }
    }
    (positions, faces)
}
