//! The prover that cheats is the real one where it does not lie.

mod lies;

use lies::party::Lie;
use lies::World;
use zk0_argument::expert::argument::prove::prove;

#[test]
fn without_a_lie_it_says_what_the_prover_says() {
    for samples in [1, 2] {
        let world = World::random(samples, 1);
        let honest = prove(&world.statement, &world.expert, &world.witness).unwrap();
        assert!(world.prove(&world.witness, Lie::Nothing) == honest);
        // Where both worlds are the same, a tale is the truth.
        assert!(world.prove(&world.witness, Lie::Rows) == honest);
        assert_eq!(world.told(&world.witness, Lie::Nothing), Ok(()));
    }
}
