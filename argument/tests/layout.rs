//! Where pieces lie, and weights that are computed from one piece to the next.

use proptest::prelude::*;
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::layout::from_largest;
use zk0_argument::multilinear::{eq_bits, EqBits};

proptest! {
    #[test]
    fn larger_pieces_come_first(sizes in prop::collection::vec(0u8..40, 0..60)) {
        let mut expected: Vec<usize> = (0..sizes.len()).collect();
        expected.sort_by_key(|&number| std::cmp::Reverse(sizes[number]));
        prop_assert_eq!(from_largest(&sizes), expected);
    }

    #[test]
    fn weights_are_those_of_each_index_alone(
        coordinates in prop::collection::vec((any::<u32>(), any::<u32>()), 1..12),
        indices in prop::collection::vec((any::<usize>(), any::<usize>()), 1..20),
    ) {
        let element = |(a, b)| Extension([Goldilocks::from_u32(a), Goldilocks::from_u32(b)]);
        let point: Vec<Extension> = coordinates.into_iter().map(element).collect();
        let mut bits = EqBits::new(&point);
        for (index, low) in indices {
            let (index, low) = (index & ((1 << point.len()) - 1), low % (point.len() + 1));
            prop_assert_eq!(bits.above(index, low), eq_bits(index >> low, &point[low..]));
        }
    }
}
