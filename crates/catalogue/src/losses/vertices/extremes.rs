//! Regularizers of degenerate faces, and of none.

use bokashi_core::{Scalar, Tape, Tensor, TensorError, Var};
use bokashi_fit::{
    RigidWeights, Rigidity, Topology, edge_length_error, laplacian_error, normal_error,
};

use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{largest, loss_and_gradients, motley, tensor};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    186 "regularizers: degenerate faces", "finite", degenerate_faces;
    187 "regularizers: no face, no vertex", "0, no gradient", meshes_of_nothing;
};

/// All regularizers of positions.
fn regularizers<'t, T: Scalar>(
    positions: Var<'t, T>,
    rest: &Tensor<T>,
    topology: &Topology,
) -> Result<Vec<Var<'t, T>>, TensorError> {
    let rigid = |weights| Rigidity::new(topology, rest, weights)?.error(positions);
    Ok(vec![
        laplacian_error(positions, &topology.uniform_laplacian())?,
        laplacian_error(positions, &topology.combinatorial_laplacian())?,
        laplacian_error(positions, &topology.cotangent_laplacian(rest)?)?,
        edge_length_error(positions, topology, 0.0)?,
        edge_length_error(positions, topology, 0.5)?,
        normal_error(positions, topology)?,
        rigid(RigidWeights::Uniform)?,
        rigid(RigidWeights::Cotangent)?,
    ])
}

fn degenerate_faces<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    // A proper face, beside faces on a line, in a point, and with a vertex twice.
    let faces = [[0, 1, 2], [1, 2, 3], [3, 4, 5], [4, 4, 5], [6, 7, 8], [2, 1, 0]];
    let topology = Topology::new(&faces, 9)?;
    for size in [1e-12, 1.0, 1e12] {
        for shape in [
            // On a line beyond the first face; all in one place; a needle.
            |k: usize| [0.0, 1.0, 0.5, 0.75, 1.0, 1.5, 3.0, 3.0, 3.0][k],
            |_| 2.0,
            |k: usize| k as f64 + if k == 4 { 1e-9 } else { 0.0 },
        ] {
            let at = |k: usize| {
                let along = shape(k / 3);
                size * [along, if k / 3 == 2 { 1.0 } else { 0.0 }, 2.0 * along][k % 3]
            };
            let positions = tensor::<T>(&[9, 3], at);
            let tape = Tape::<T>::new();
            let x = tape.leaf(&positions);
            for loss in regularizers(x, &positions, &topology)? {
                let (loss, gradients) = loss_and_gradients(loss, &[x])?;
                let is_finite = loss.is_finite() && gradients.iter().all(|g| g.is_finite());
                wrong += usize::from(!is_finite || loss < 0.0);
            }
        }
    }
    Ok(Verdict::exactly("finite, and so is the gradient", wrong))
}

fn meshes_of_nothing<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    for count in [0, 1, 4] {
        let topology = Topology::new(&[], count)?;
        let tape = Tape::<T>::new();
        let positions = tensor(&[count, 3], motley);
        let x = tape.leaf(&positions);
        for loss in regularizers(x, &positions, &topology)? {
            let (loss, gradients) = loss_and_gradients(loss, &[x])?;
            wrong += usize::from(loss != 0.0 || largest(gradients) != 0.0);
        }
    }
    Ok(Verdict::exactly("0, without a gradient", wrong))
}
