//! No instances, and meshes without vertices.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Assembly, Mesh, Size, project_instances, rasterize};

use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{numbers, vector};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    128 "no instances, no vertices", "nothing drawn, zero gradients", instances_of_nothing;
};

const SIZE: Size = Size { width: 40, height: 30 };

fn instances_of_nothing<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let camera = vector(&tape, [0.5; 16]).reshape([4, 4])?;
    let mut wrong = 0;
    for (instances, vertices) in [(0, 3), (3, 0), (0, 0)] {
        let positions = tape.leaf(&Tensor::zeros([vertices, 3]));
        let matrices = tape.leaf(&Tensor::zeros([instances, 4, 4]));
        let clip = project_instances(positions, matrices, camera)?;
        let gradients = clip.sum().backward()?;
        let bars = [positions, matrices, camera].map(|leaf| numbers(&gradients.get_or_zeros(leaf)));
        wrong += usize::from(clip.shape() != [0, 4].into());
        wrong += bars.iter().flatten().filter(|&&bar| bar != 0.0).count();
        // An assembly of nothing is nothing.
        let empty = Mesh::new(Vec::new(), vertices)?;
        let assembly = Assembly::new(&[(&empty, instances), (&Mesh::new(vec![[0; 3]], 1)?, 0)])?;
        let rows = assembly.mesh().vertex_count();
        let clip = tape.leaf(&Tensor::zeros([rows, 4]));
        let seen = rasterize(clip, assembly.mesh(), SIZE)?;
        wrong += seen.coverage.count() + usize::from(assembly.place(0).is_some());
    }
    Ok(Verdict::exactly("an empty clip space, no fragments, gradients of 0", wrong))
}
