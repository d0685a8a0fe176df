//! Scenes that the tests of several files look at.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Fragments, Mesh, Size, rasterize};

/// The size of `surface`'s image.
pub(super) const SMALL: Size = Size { width: 5, height: 3 };

/// The fragments of a face over part of an image, and values `[N, 2]` on it.
pub(super) fn surface<T: Scalar>(tape: &Tape<T>) -> (Fragments<'_, T>, Var<'_, T>) {
    let clip = [-1.2, -0.9, 0.0, 1.0, 0.6, -0.7, 0.0, 1.0, 0.1, 1.3, 0.0, 1.0].map(T::from_f64);
    let clip = tape.leaf(&Tensor::new([3, 4], clip.to_vec()).unwrap());
    let fragments = rasterize(clip, &Mesh::new(vec![[0, 1, 2]], 3).unwrap(), SMALL).unwrap();
    let count = fragments.coverage.count();
    assert!((3..12).contains(&count), "{count}");
    let values = Tensor::from_flat_fn([count, 2], |k| T::from_f64(100.0 + k as f64));
    (fragments, tape.leaf(&values))
}

/// Numbers in [-1/2, 1/2] of which no two are alike.
pub(super) fn number(k: usize) -> f64 {
    ((k * 7919 + 13) % 1009) as f64 / 1009.0 - 0.5
}

/// The positions `[V, 3]` and the faces of a bent sheet of `columns` by `rows` quads.
pub(super) fn bent_sheet(columns: usize, rows: usize) -> (Vec<f64>, Vec<[u32; 3]>) {
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
