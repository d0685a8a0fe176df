use bokashi_core::{Recording, Tape, Tensor, TensorError};
use smallvec::smallvec;

/// x y and exp x of x and y.
fn record(tape: Tape<f64>, x: &Tensor<f64>, y: &Tensor<f64>) -> Recording<f64> {
    Recording::new(tape, |tape| {
        let (x, y) = (tape.leaf(x), tape.leaf(y));
        Ok::<_, TensorError>([smallvec![x, y], smallvec![x.try_mul(y)?, x.exp()]])
    })
    .unwrap()
}

#[test]
fn a_pipeline_without_a_lifetime_is_pulled_back_on_another_thread_as_often_as_one_likes() {
    let (x, y) = (Tensor::from([0.5, -1.0]), Tensor::from([3.0, 4.0]));
    let recording = record(Tape::new(), &x, &y);
    assert_eq!((recording.input_count(), recording.output_count()), (2, 2));
    let recording = std::thread::spawn(move || recording).join().unwrap();
    assert_eq!(recording.value(0).data(), [1.5, -4.0]);
    assert_eq!(recording.value(1).data(), x.map(f64::exp).data());
    let ones = Tensor::full([2], 1.0);
    for _ in 0..2 {
        let both = recording.pull_back(&[Some(&ones), Some(&ones)]).unwrap();
        assert_eq!(both[0].as_ref().unwrap().data(), [3.0 + f64::exp(0.5), 4.0 + f64::exp(-1.0)]);
        assert_eq!(both[1].as_ref().unwrap().data(), x.data());
        let of_exp = recording.pull_back(&[None, Some(&ones)]).unwrap();
        assert_eq!(
            (of_exp[0].as_ref().unwrap().data(), &of_exp[1]),
            (recording.value(1).data(), &None)
        );
        assert_eq!(recording.pull_back(&[None, None]).unwrap()[..], [None, None]);
    }
    // Its memory serves the next one.
    let again = record(recording.into_tape(), &y, &x);
    assert_eq!(again.value(0).data(), [1.5, -4.0]);
}

#[test]
fn a_variable_that_is_two_inputs_has_its_gradient_twice_and_an_output_may_be_an_input() {
    let recording = Recording::new(Tape::new(), |tape| {
        let x = tape.leaf_scalar(3.0);
        Ok::<_, TensorError>([smallvec![x, x], smallvec![x.square(), x]])
    })
    .unwrap();
    let one = Tensor::scalar(1.0);
    let gradients = recording.pull_back(&[Some(&one), Some(&one)]).unwrap();
    assert_eq!(gradients[..], [Some(Tensor::scalar(7.0)), Some(Tensor::scalar(7.0))]);
    let second = recording.pull_back_to(&[Some(&one), None], |k| k == 1).unwrap();
    assert_eq!(second[..], [None, Some(Tensor::scalar(6.0))]);
}

#[test]
fn what_does_not_fit_a_recording_is_refused() {
    let recording = record(Tape::new(), &Tensor::scalar(1.0), &Tensor::scalar(2.0));
    let one = Tensor::scalar(1.0);
    let refused = recording.pull_back(&[Some(&one)]).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "pull_back needs as many upstream gradients as outputs, 2, got 1"
    );
    let row = Tensor::from([1.0]);
    assert!(matches!(recording.pull_back(&[Some(&row), None]), Err(TensorError::Mismatch { .. })));
    let failed: Result<_, TensorError> = Recording::new(Tape::new(), |tape| {
        let x = tape.leaf_of([2], &[1.0])?;
        Ok([smallvec![x], smallvec![x]])
    });
    assert_eq!(failed.unwrap_err(), TensorError::Length { shape: [2].into(), entries: 1 });
}
