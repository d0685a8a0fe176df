//! Fragments of a fixed scene, with numbers of the caller's in the place of theirs.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Fragments, Mesh, RasterOptions, RenderError, Sampling, rasterize};

use crate::scenes::size;

/// Fragments of a fixed scene, whose barycentrics are a variable of their own.
pub(crate) fn fixed_fragments<'t, T: Scalar>(
    tape: &'t Tape<T>,
    barycentrics: Option<Var<'t, T>>,
) -> Result<Fragments<'t, T>, RenderError> {
    let clip = [
        [-0.9, -0.8, 0.0, 1.0],
        [1.9, -1.6, 0.0, 2.0],
        [1.2, 1.4, 0.1, 1.5],
        [-0.4, 0.4, 0.0, 0.5],
    ];
    let clip = tape.constant(&Tensor::from_flat_fn([4, 4], |k| T::from_f64(clip[k / 4][k % 4])));
    let mesh = Mesh::new(vec![[0, 1, 2], [0, 2, 3]], 4)?;
    let fragments = rasterize(clip, &mesh, size(6, 4))?;
    let barycentrics = barycentrics.unwrap_or(fragments.barycentrics);
    Ok(Fragments { barycentrics, ..fragments })
}

/// How many fragments [`fixed_fragments`] has.
pub(crate) fn fixed_count() -> usize {
    fixed_fragments::<f64>(&Tape::new(), None).unwrap().coverage.count()
}

/// The same scene with exact coverage.
pub(crate) fn exact_fragments<T: Scalar>(tape: &Tape<T>) -> Result<Fragments<'_, T>, RenderError> {
    let fixed = fixed_fragments(tape, None)?;
    let options = RasterOptions::new(fixed.coverage.size()).sampling(Sampling::Exact);
    rasterize(fixed.clip, fixed.coverage.mesh(), options.creases(&[]))
}
