use bokashi_core::Shape;

#[test]
#[should_panic(expected = "fewer entries than fit an index, got [4294967296, 4294967296]")]
fn a_size_beyond_any_index_never_wraps_around() {
    let _ = Shape::from([1 << 32, 1 << 32]).size();
}
