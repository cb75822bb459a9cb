//! Row 10. A node makes weights whose velocities are too large for an int16, by just so much that they come out right if they wrap.

use crate::attacks::attack::{Attack, Defence, Proof};
use crate::attacks::proofs::guest;
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 10,
    name: "a node proves an update whose values wrap around to a lower loss",
    module: module_path!(),
    reason: "velocity (action_out_proj): ",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "the guest checks the range of every value that it narrows",
        out: &[SourceChange {
            file: "circuits/src/model/multiply.rs",
            replacements: &[
                (
                    "fit.check(output.site, self.overflow)?;",
                    "if !OUT {
                fit.check(output.site, self.overflow)?;
            }",
                ),
                (
                    "sum.clamp(i32::MIN.into(), i32::MAX.into()) as i32",
                    "if OUT {
            sum as i32
        } else {
            sum.clamp(i32::MIN.into(), i32::MAX.into()) as i32
        }",
                ),
            ],
        }],
    },
    carry_out: || {
        guest(
            "wraps a velocity",
            "an update whose velocities are off by 32",
        )
    },
};

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
