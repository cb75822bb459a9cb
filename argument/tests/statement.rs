//! The encoding of a statement: it gives the statement back, and words that are no encoding are refused.

mod models;

use models::Models;
use zk0_argument::expert::encoding::NotAStatement;
use zk0_argument::expert::statement::Statement;
use zk0_argument::expert::witness::evaluate;
use zk0_circuits::EvalSpec;

fn statement() -> Statement {
    let models = Models::new(&EvalSpec::micro(), 2, 1);
    let weights = [&models.base, &models.update];
    evaluate(&models.spec, weights, &models.samples).unwrap().0
}

#[test]
fn an_encoding_is_read_back() {
    let statement = statement();
    let words = statement.encode();
    let read = Statement::decode(&words).unwrap();
    assert_eq!(format!("{read:?}"), format!("{statement:?}"));
    assert_eq!(read.encode(), words);
    assert_eq!(read.digest(), statement.digest());
}

#[test]
fn words_that_are_no_encoding_are_refused() {
    let words = statement().encode();
    for length in 0..words.len() {
        assert!(
            Statement::decode(&words[..length]).is_err(),
            "{length} words"
        );
    }
    assert_eq!(
        Statement::decode(&[&words[..], &[0]].concat()).unwrap_err(),
        NotAStatement::Encoding
    );
    // Whatever bit is changed, another statement is read or none: no two encodings are of one statement.
    for place in 0..words.len() {
        for bit in 0..64 {
            let mut changed = words.clone();
            changed[place] ^= 1 << bit;
            if let Ok(read) = Statement::decode(&changed) {
                assert_eq!(read.encode(), changed, "bit {bit} of word {place}");
            }
        }
    }
}
