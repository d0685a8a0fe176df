use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{project, project_instances};
use rayon::ThreadPoolBuilder;

/// As many points as are shared among threads as one piece.
const POINTS_PER_PIECE: usize = 1 << 13;

fn number(k: usize) -> f64 {
    ((k * 7919 + 13) % 1009) as f64 / 1009.0 - 0.4
}

fn leaf<'t, T: Scalar>(tape: &'t Tape<T>, shape: &[usize], seed: usize) -> Var<'t, T> {
    tape.leaf(&Tensor::from_flat_fn(shape, |k| T::from_f64(number(k + seed))))
}

/// Each instance as it is projected alone, one after another.
fn one_by_one<'t>(
    positions: Var<'t, f64>,
    matrices: Var<'t, f64>,
    camera: Var<'t, f64>,
) -> Var<'t, f64> {
    let alone = |k: usize| {
        let model = matrices.slice(0, k..k + 1).unwrap().reshape([4, 4]).unwrap();
        project(positions, camera.matmul(model).unwrap(), None).unwrap()
    };
    let all: Vec<_> = (0..matrices.shape()[0]).map(alone).collect();
    Var::concat(&all, 0).unwrap()
}

#[test]
fn more_rows_than_a_mesh_can_have_are_refused_before_memory_is_taken() {
    let tape = Tape::<f32>::new();
    let positions = tape.leaf_full([1 << 16, 3], 0.5);
    let matrices = tape.leaf_full([1 << 15, 4, 4], 0.5);
    let error = project_instances(positions, matrices, tape.leaf_full([4, 4], 1.0));
    let message = error.unwrap_err().to_string();
    assert!(message.ends_with(&(1_u64 << 31).to_string()), "{message}");
}

#[test]
fn instances_are_projected_as_each_would_be_alone() {
    // Blocks and pieces of more than a mesh, and of less.
    for (instances, vertices) in [(1, 1), (3, 5), (40, 300), (2, POINTS_PER_PIECE + 70)] {
        let tape = Tape::<f64>::new();
        let positions = leaf(&tape, &[vertices, 3], 0);
        let matrices = leaf(&tape, &[instances, 4, 4], 100);
        let camera = leaf(&tape, &[4, 4], 200);
        let upstream = Tensor::from_flat_fn([instances * vertices, 4], |k| number(3 * k));
        let results = [
            project_instances(positions, matrices, camera).unwrap(),
            one_by_one(positions, matrices, camera),
        ]
        .map(|clip| {
            let gradients = tape.vjp(&[(clip, &upstream)]).unwrap();
            let leaves = [positions, matrices, camera];
            (clip.value(), leaves.map(|leaf| gradients.get(leaf).unwrap().clone()))
        });
        let [(found, bars), (expected, expected_bars)] = &results;
        let pairs = bars.iter().zip(expected_bars).chain([(found, expected)]);
        for (found, expected) in pairs {
            assert_eq!(found.shape(), expected.shape());
            for (found, expected) in found.data().iter().zip(expected.data()) {
                approx::assert_relative_eq!(found, expected, epsilon = 1e-10);
            }
        }
    }
}

#[test]
fn no_instances_and_no_vertices_are_an_empty_clip_space() {
    let tape = Tape::<f32>::new();
    for (instances, vertices) in [(0, 3), (3, 0), (0, 0)] {
        let positions = leaf(&tape, &[vertices, 3], 0);
        let matrices = leaf(&tape, &[instances, 4, 4], 1);
        let camera = leaf(&tape, &[4, 4], 2);
        let clip = project_instances(positions, matrices, camera).unwrap();
        assert_eq!(clip.shape(), [0, 4].into());
        let gradients = clip.sum().backward().unwrap();
        for of in [positions, matrices, camera] {
            assert!(gradients.get_or_zeros(of).data().iter().all(|&bar| bar == 0.0));
        }
    }
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let run = |threads: usize| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let shapes = [(7, 3000), (500, 40), (2, 2 * POINTS_PER_PIECE + 5)];
            shapes.map(|(instances, vertices)| {
                let tape = Tape::<f32>::new();
                let positions = leaf(&tape, &[vertices, 3], 0);
                let matrices = leaf(&tape, &[instances, 4, 4], 100);
                let camera = leaf(&tape, &[4, 4], 200);
                let clip = project_instances(positions, matrices, camera).unwrap();
                let gradients = clip.square().sum().backward().unwrap();
                let bars =
                    [positions, matrices, camera].map(|leaf| gradients.get(leaf).unwrap().clone());
                (clip.value(), bars)
            })
        })
    };
    let alone = run(1);
    assert!([2, 3].iter().all(|&threads| run(threads) == alone));
}
