use bokashi_core::{Tape, Tensor};

#[test]
fn the_buffer_is_shared_and_outlives_the_step() {
    let mut tape = Tape::new();
    let x = tape.leaf_copied(&Tensor::from_flat_fn([2, 3], |k| k as f64));
    let y = x.reshape([6]).unwrap();
    assert_eq!(x.value().data().as_ptr(), y.value().data().as_ptr());
    let held = y.value();
    tape.reset();
    let _ = tape.constant_full([6], 9.0) + tape.constant_full([6], 9.0);
    assert_eq!(held.data(), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
}

#[test]
fn a_shared_buffer_goes_back_to_the_pool_once() {
    let mut tape = Tape::new();
    for _ in 0..3 {
        let x = tape.leaf_copied(&Tensor::full([4], 1.0));
        let y = x.reshape([2, 2]).unwrap().reshape([4]).unwrap();
        let [a, b] = [2.0, 3.0].map(|value| tape.constant_full([4], value));
        assert_eq!([a, b, y].map(|of| of.value()[[3]]), [2.0, 3.0, 1.0]);
        tape.reset();
    }
}
