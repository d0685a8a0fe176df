use bokashi_core::Mask;

#[test]
fn masks_of_lists_and_of_functions_are_the_same() {
    let expected = Mask::new([2, 2], [true, false, false, true]).unwrap();
    let same = [
        Mask::from_fn([2, 2], |[i, j]| i == j),
        Mask::from_flat_fn([2, 2], |k| k % 3 == 0),
        Mask::from([true, false, false, true]).reshaped([2, 2]).unwrap(),
    ];
    assert!(same.iter().all(|mask| *mask == expected && mask.count() == 2));
    assert_eq!(Mask::full([0, 3], true).count(), 0);
    assert_eq!(Mask::from_fn([3, 0], |_| true).data(), [false; 0]);
    let message = "shape [3] needs 3 entries, got 2";
    assert_eq!(Mask::new([3], [true, false]).unwrap_err().to_string(), message);
    assert_eq!(Mask::from([true; 2]).reshaped([3]).unwrap_err().to_string(), message);
}

#[test]
fn logic_holds_de_morgans_laws_with_broadcasting() {
    let a = Mask::from_fn([2, 1], |[i, _]| i == 0);
    for bits in 0..8 {
        let b = Mask::from_flat_fn([3], |k| bits >> k & 1 == 1);
        let both = a.and(&b).unwrap();
        assert_eq!(*both.shape(), [2, 3].into());
        assert_eq!(both, !(!&a).or(&!&b).unwrap());
        assert_eq!(a.or(&b).unwrap(), !(!&a).and(&!&b).unwrap());
        assert_eq!(both, Mask::from_fn([2, 3], |[i, j]| i == 0 && bits >> j & 1 == 1));
    }
    let message = "and needs shapes that broadcast, got [2] and [3]";
    let [two, three] = [2, 3].map(|n| Mask::full([n], true));
    assert_eq!(two.and(&three).unwrap_err().to_string(), message);
}
