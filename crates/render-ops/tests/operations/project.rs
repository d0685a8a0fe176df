use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{Pose, project};
use glam::dcamera::rh::proj::opengl::perspective;
use glam::dcamera::rh::view::look_at_mat4;
use glam::{DMat4, DVec3};
use rayon::ThreadPoolBuilder;

/// As many points as are shared among threads as one piece.
const POINTS_PER_PIECE: usize = 1 << 13;

#[test]
fn without_a_pose_it_is_the_matrix_product() {
    let camera = perspective(1.0, 1.5, 0.1, 10.0)
        * look_at_mat4(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Y);
    let tape = Tape::<f64>::new();
    let p = tape.leaf(&Tensor::new([1, 3], vec![0.3, -0.2, 0.5]).unwrap());
    let clip = project(p, &camera, None).unwrap().value();
    let expected = camera * glam::DVec4::new(0.3, -0.2, 0.5, 1.0);
    for (k, &entry) in clip.data().iter().enumerate() {
        approx::assert_relative_eq!(entry, expected[k], max_relative = 1e-14);
    }
}

#[test]
fn the_length_of_the_quaternion_does_not_matter() {
    let tape = Tape::<f64>::new();
    let p = tape.leaf(&Tensor::new([1, 3], vec![0.3, -0.2, 0.5]).unwrap());
    let translation = tape.leaf(&Tensor::new([3], vec![0.1, 0.2, -3.0]).unwrap());
    let clip = |length: f64| {
        let q = [0.1, 0.7, -0.5, 0.5].map(|entry| entry * length);
        let rotation = tape.leaf(&Tensor::new([4], q.to_vec()).unwrap());
        project(p, &DMat4::IDENTITY, Some(Pose { rotation, translation })).unwrap().value()
    };
    for (one, other) in clip(1.0).data().iter().zip(clip(4.0).data()) {
        approx::assert_relative_eq!(one, other, max_relative = 1e-14);
    }
}

/// A camera none of whose entries is zero.
fn any_camera() -> DMat4 {
    let turned = look_at_mat4(DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.2, -0.1, 0.3), DVec3::Y);
    DMat4::from_cols_array(&std::array::from_fn(|k| 0.1 + 0.03 * k as f64)) + turned
}

const POSITIONS: [f64; 9] = [0.3, -0.2, 0.5, -0.7, 0.1, 0.9, 0.4, 0.8, -0.6];

#[test]
fn a_pose_is_the_matrix_product_with_a_rotation_and_a_translation() {
    let q = [0.1, 0.7, -0.5, 0.3];
    let turn = glam::DQuat::from_array(q).normalize();
    let matrix = any_camera() * DMat4::from_rotation_translation(turn, DVec3::new(0.4, -0.6, 1.5));
    let tape = Tape::<f64>::new();
    let positions = tape.leaf(&Tensor::new([3, 3], POSITIONS.to_vec()).unwrap());
    let rotation = tape.leaf(&Tensor::new([4], q.to_vec()).unwrap());
    let translation = tape.leaf(&Tensor::new([3], vec![0.4, -0.6, 1.5]).unwrap());
    let clip = project(positions, &any_camera(), Some(Pose { rotation, translation })).unwrap();
    for (p, clip) in POSITIONS.chunks(3).zip(clip.value().data().chunks(4)) {
        let expected = matrix * DVec3::from_slice(p).extend(1.0);
        for k in 0..4 {
            approx::assert_relative_eq!(clip[k], expected[k], epsilon = 1e-14);
        }
    }
}

/// The camera, row-major.
fn entries(camera: DMat4) -> Vec<f64> {
    camera.transpose().to_cols_array().to_vec()
}

#[test]
fn a_variable_camera_gives_the_bits_of_a_fixed_one() {
    let tape = Tape::<f64>::new();
    let leaf = |shape: &[usize], entries: &[f64]| {
        tape.leaf(&Tensor::new(shape, entries.to_vec()).unwrap())
    };
    let positions = leaf(&[3, 3], &POSITIONS);
    let camera = leaf(&[4, 4], &entries(any_camera()));
    let pose = Pose {
        rotation: leaf(&[4], &[0.1, 0.7, -0.5, 0.3]),
        translation: leaf(&[3], &[0.4, -0.6, 1.5]),
    };
    let upstream = Tensor::from_flat_fn([3, 4], |k| (k as f64).sin());
    for pose in [None, Some(pose)] {
        let clip = [
            project(positions, &any_camera(), pose).unwrap(),
            project(positions, camera, pose).unwrap(),
        ];
        assert_eq!(clip[0].value(), clip[1].value());
        let bars = clip.map(|clip| tape.vjp(&[(clip, &upstream)]).unwrap());
        assert_eq!(bars[0].get(positions), bars[1].get(positions));
        if let Some(Pose { rotation, translation }) = pose {
            assert_eq!(bars[0].get(rotation), bars[1].get(rotation));
            assert_eq!(bars[0].get(translation), bars[1].get(translation));
        }
    }
}

#[test]
fn sums_over_many_vertices_have_the_same_bits_on_any_number_of_threads() {
    let count = 3 * POINTS_PER_PIECE + 17;
    let gradients = |threads: usize| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let tape = Tape::<f32>::new();
            let number = |k: usize| ((k * 7919) % 1009) as f32 / 1009.0 - 0.3;
            let leaf = |shape: &[usize]| tape.leaf(&Tensor::from_flat_fn(shape, number));
            let (positions, camera) = (leaf(&[count, 3]), leaf(&[4, 4]));
            let pose = Pose { rotation: leaf(&[4]), translation: leaf(&[3]) };
            let clip = project(positions, camera, Some(pose)).unwrap();
            let gradients = clip.square().sum().backward().unwrap();
            [positions, camera, pose.rotation, pose.translation]
                .map(|leaf| gradients.get(leaf).unwrap().clone())
        })
    };
    let alone = gradients(1);
    assert!([2, 3].iter().all(|&threads| gradients(threads) == alone));
}

#[test]
fn without_positions_clip_space_is_empty() {
    let tape = Tape::<f32>::new();
    let none = tape.leaf(&Tensor::zeros([0, 3]));
    let clip = project(none, &DMat4::IDENTITY, None).unwrap();
    assert_eq!(clip.shape(), [0, 4].into());
}
