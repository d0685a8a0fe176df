use std::panic::catch_unwind;
use std::sync::Arc;

use bokashi_core::{Tape, Tensor};

#[test]
fn data_must_fill_the_shape() {
    let error = Tensor::new([2, 3], vec![0.0_f32; 5]).unwrap_err();
    assert_eq!(error.to_string(), "shape [2, 3] needs 6 entries, got 5");
    assert!(Tensor::new([0, 3], Vec::<f32>::new()).is_ok());
    // A product that wraps around is no match.
    let huge = Tensor::new([1 << 33, 1 << 31], Vec::<f32>::new()).unwrap_err();
    assert_eq!(
        huge.to_string(),
        "shape [8589934592, 2147483648] needs more entries than fit an index, got 0"
    );
}

#[test]
fn entries_by_index_are_those_in_row_major_order() {
    let mut t = Tensor::from_fn([2, 3, 2], |[i, j, k]| (100 * i + 10 * j + k) as f64);
    assert_eq!(t.data()[..4], [0.0, 1.0, 10.0, 11.0]);
    assert_eq!((t[[1, 2, 0]], t.data()[10]), (120.0, 120.0));
    let shared = t.clone();
    t[[1, 2, 0]] = 7.0;
    assert_eq!((t[[1, 2, 0]], t.data()[10], shared[[1, 2, 0]]), (7.0, 7.0, 120.0));
    let mut scalar = Tensor::from_fn([], |[]| 3.0_f32);
    scalar[[]] += 1.0;
    assert_eq!((scalar[[]], scalar.item()), (4.0, 4.0));
    assert_eq!(Tensor::from_flat_fn([2, 0], |_| 1.0_f32).size(), 0);
}

#[test]
fn an_index_outside_the_shape_is_refused_even_where_the_buffer_has_a_place() {
    let t = Tensor::<f64>::zeros([2, 3]);
    for wrong in [
        catch_unwind(|| t[[0, 3]]),
        catch_unwind(|| t[[2, 0]]),
        catch_unwind(|| t[[1]]),
        catch_unwind(|| t[[0, 0, 0]]),
    ] {
        let said = *wrong.unwrap_err().downcast::<String>().unwrap();
        assert!(said.starts_with("an index needs to lie within shape [2, 3], got ["), "{said}");
    }
}

#[test]
#[should_panic(expected = "`item` needs exactly one entry, got shape [2]")]
fn an_item_is_the_only_one() {
    assert_eq!(Tensor::full([1, 1], 5.0_f64).item(), 5.0);
    Tensor::<f32>::zeros([2]).item();
}

#[test]
fn entries_of_somebody_else_are_read_where_they_lie_and_copied_before_they_are_written_to() {
    let owner = Arc::new(vec![1.0, 2.0, 3.0, 4.0]);
    let theirs = Tensor::<f64>::from_owner([2, 2], owner.clone()).unwrap();
    assert!(std::ptr::eq(theirs.data(), owner.as_slice()));
    assert_eq!(theirs, Tensor::new([2, 2], owner.to_vec()).unwrap());
    let error = Tensor::<f64>::from_owner([3], owner.clone()).unwrap_err();
    assert_eq!(error.to_string(), "shape [3] needs 3 entries, got 4");
    // On a tape, and as an upstream gradient.
    let mut tape = Tape::new();
    let x = tape.leaf(&theirs);
    assert!(std::ptr::eq(x.value().data(), owner.as_slice()));
    let gradients = tape.vjp(&[(x + x, &theirs)]).unwrap();
    assert_eq!(gradients.get(x).unwrap().data(), [2.0, 4.0, 6.0, 8.0]);
    drop(gradients);
    tape.recycle(x.value());
    tape.reset();
    let mut own = theirs.clone();
    own[[0, 0]] = 7.0;
    assert_eq!(
        (own.data(), Vec::from(theirs.clone())),
        (&[7.0, 2.0, 3.0, 4.0][..], owner.to_vec())
    );
    drop(theirs);
    assert_eq!(Arc::strong_count(&owner), 1);
}

#[test]
fn writing_to_a_shared_buffer_leaves_the_other_holder_alone() {
    let a = Tensor::full([2], 1.0_f64);
    let mut b = a.clone();
    b.data_mut()[0] = 2.0;
    assert_eq!(a.data(), [1.0, 1.0]);
    assert_eq!(b.data(), [2.0, 1.0]);
}

#[test]
fn reshaping_keeps_entries_and_count() {
    let a = Tensor::from_flat_fn([2, 3], |k| k as f32);
    assert_eq!(a.reshaped([3, 2]).unwrap().data(), a.data());
    assert!(a.reshaped([4]).is_err());
}
