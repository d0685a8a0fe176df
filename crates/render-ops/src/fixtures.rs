//! A scene that the tests of several files look at.

use std::sync::Arc;

use bokashi_core::{Tape, Tensor};

use crate::coverage::Coverage;
use crate::mesh::Mesh;
use crate::rasterize::rasterize;
use crate::size::Size;

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
