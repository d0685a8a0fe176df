use bokashi_core::parallel::ENTRIES_PER_PIECE;
use bokashi_core::sum;

#[test]
fn a_sum_of_integers_is_exact_at_every_length() {
    for length in [0, 1, 7, 8, 9, ENTRIES_PER_PIECE, 3 * ENTRIES_PER_PIECE + 5] {
        let expected = (length * length.saturating_sub(1) / 2) as f64;
        assert_eq!(sum::<f32>(length, |k| k as f64), expected);
    }
}
