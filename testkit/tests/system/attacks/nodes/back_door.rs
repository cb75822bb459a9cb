//! Row 9. A node writes a back door where no sample looks: into weights that the evaluation does not read, and that a robot reads when it
//! moves. Its claim is true, and it could prove it.

use crate::attacks::attack::{over_the_network, Attack, Defence, Outcome, Proof};
use crate::attacks::scene::{commit, proving_network, submitted};
use zk0_circuits::EvalSpec;
use zk0_testkit::aggregator::{digest, weights};
use zk0_testkit::changed_copy::SourceChange;
use zk0_weights::scale::{exact, narrowed};
use zk0_weights::{Format, WeightFileError};

pub const ATTACK: Attack = Attack {
    number: 9,
    name: "a node changes weights that no sample evaluates, and that robots use",
    module: module_path!(),
    reason: "is not evaluated, so it has to stay as in the base",
    proof: Proof::SeenFirst,
    defence: Defence {
        check: "weights that nobody evaluates are the base's",
        out: &[SourceChange {
            file: "verifier/src/update.rs",
            replacements: &[(
                "        unread.check(&self.format, &weights).map_err(changed)?;\n",
                "        if !OUT {
            unread.check(&self.format, &weights).map_err(changed)?;
        }\n",
            )],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

/// The base, but for the last row of the last layer, which is of an action that this robot does not have.
fn with_back_door() -> Vec<u8> {
    let format = Format::new(&EvalSpec::micro()).unwrap();
    let base = weights(0);
    let opened = format.open(&base[..]).unwrap();
    let changed = format.assemble(|index| {
        let tensor = opened.tensor(index)?;
        let values = tensor.values.iter();
        let mut values: Vec<i128> = values
            .map(|value| exact(*value, tensor.bits).into())
            .collect();
        if format.tensors()[index].name == "model.action_out_proj.weight" {
            // Half as large, and of the other sign.
            let width = values.len() / EvalSpec::micro().dims.max_action_dim as usize;
            let row = values.len() - width;
            values[row..].iter_mut().for_each(|value| *value /= -2);
        }
        Ok::<_, WeightFileError>(narrowed(&values, 1, format.limits()[index]))
    });
    format.write(&changed.unwrap())
}

async fn carry_out() -> Outcome {
    let (network, cheat, _) = proving_network(|_| ()).await;
    let update = with_back_door();
    commit(&network, &cheat, &update).await;
    let claim = cheat.claim(&network).await;
    let won = format!(
        "the round counts {}, in which a row that nobody evaluated is another one",
        digest(&update).blob
    );
    submitted(&network, &cheat, claim, &won).await
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
