use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::transform_points;
use glam::{DMat4, DQuat, DVec3};

#[test]
fn it_is_glams_transformation_of_each_point() {
    let turn = DQuat::from_xyzw(0.1, 0.7, -0.5, 0.3).normalize();
    let matrix = DMat4::from_rotation_translation(turn, DVec3::new(0.4, -0.6, 1.5));
    let tape = Tape::<f64>::new();
    let points = Tensor::from_flat_fn([5, 3], |k| (3.0 * k as f64).sin());
    let rows = tape.leaf(&Tensor::from(matrix.transpose().to_cols_array_2d()));
    let found = transform_points(tape.leaf(&points), rows).unwrap().value();
    for (p, found) in points.data().chunks(3).zip(found.data().chunks(3)) {
        let expected = matrix.transform_point3(DVec3::from_slice(p)).to_array();
        for k in 0..3 {
            approx::assert_relative_eq!(found[k], expected[k], epsilon = 1e-15);
        }
    }
}
