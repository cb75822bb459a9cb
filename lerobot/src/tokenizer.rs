//! Instructions as token ids: a trained `tokenizer.json`, used as LeRobot does for SmolVLA.

use std::io::ErrorKind;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::path::{Path, PathBuf};

use tokenizers::models::ModelWrapper;
use tokenizers::{TruncationDirection, TruncationParams, TruncationStrategy};
use zk0_files::bounded_file;

use crate::config::PolicyConfig;
use crate::error::{Result, StoredPolicyError};

/// Turns an instruction into at most `max_language_tokens` token ids below the policy's vocabulary. Threads share it.
pub trait Tokenizer: Send + Sync {
    /// An instruction's token ids, without padding.
    ///
    /// # Errors
    /// The instruction does not give tokens that the policy reads.
    fn tokens(&self, task: &str) -> Result<Vec<u32>>;
}

/// Largest `tokenizer.json` read, in bytes; SmolVLM2's has 3.5 MB.
const MAX_FILE: u64 = 64 << 20;

/// The `tokenizers` library's tokenizer, for one policy.
///
/// As in LeRobot, an instruction gets a final line break if it lacks one, special tokens follow the file, and what exceeds
/// `max_language_tokens` (LeRobot's `tokenizer_max_length`) is cut on the right. The file's own truncation and padding do not apply.
pub struct TrainedTokenizer {
    /// The file; `None` if it came within a policy file.
    path: Option<PathBuf>,
    definition: String,
    inner: tokenizers::Tokenizer,
    vocabulary: usize,
    limit: usize,
}

impl TrainedTokenizer {
    /// Reads a `tokenizer.json` for a policy's vocabulary and instruction length.
    ///
    /// # Errors
    /// [`StoredPolicyError::AtPath`]: the file is unreadable, larger than 64 MiB, not a tokenizer, or gives other tokens each time (BPE
    /// dropout).
    pub fn read(path: impl Into<PathBuf>, config: &PolicyConfig) -> Result<Self> {
        let path = path.into();
        let made = load(&path).and_then(|definition| Self::of(definition, config));
        match made {
            Ok(made) => Ok(Self {
                path: Some(path),
                ..made
            }),
            Err(cause) => Err(StoredPolicyError::file(&path, cause)),
        }
    }

    /// From the text of a `tokenizer.json` in a policy file.
    ///
    /// # Errors
    /// [`StoredPolicyError::Tokenizer`], for the reasons of [`Self::read`].
    pub fn parse(definition: &str, config: &PolicyConfig) -> Result<Self> {
        Self::of(definition.to_owned(), config).map_err(StoredPolicyError::Tokenizer)
    }

    /// The text of its `tokenizer.json`.
    pub fn definition(&self) -> &str {
        &self.definition
    }

    fn of(definition: String, config: &PolicyConfig) -> std::result::Result<Self, String> {
        Ok(Self {
            path: None,
            inner: build(&definition, config.max_language_tokens)?,
            definition,
            vocabulary: config.text.vocabulary,
            limit: config.max_language_tokens,
        })
    }

    fn wrong(&self, cause: String) -> StoredPolicyError {
        match &self.path {
            Some(path) => StoredPolicyError::file(path, cause),
            None => StoredPolicyError::Tokenizer(cause),
        }
    }
}

impl Tokenizer for TrainedTokenizer {
    fn tokens(&self, task: &str) -> Result<Vec<u32>> {
        let mut text = task.to_owned();
        if !text.ends_with('\n') {
            text.push('\n');
        }
        let encoding = guarded(|| self.inner.encode(text, true))
            .map_err(|cause| self.wrong(format!("cannot split {task:?} into tokens: {cause}")))?;
        let ids = encoding.get_ids();
        if let Some(id) = ids.iter().find(|id| **id as usize >= self.vocabulary) {
            return Err(self.wrong(format!(
                "gives token id {id} ({:?}) for {task:?}, the policy knows {} tokens; take the tokenizer that the policy was \
                 trained with",
                self.inner.id_to_token(*id).unwrap_or_default(),
                self.vocabulary
            )));
        }
        if ids.len() > self.limit {
            return Err(self.wrong(format!(
                "adds more special tokens than the {} tokens that the policy reads",
                self.limit
            )));
        }
        Ok(ids.to_vec())
    }
}

fn load(path: &Path) -> std::result::Result<String, String> {
    let json = bounded_file::read(path, MAX_FILE).map_err(|e| match e.kind() {
        ErrorKind::FileTooLarge => too_large(),
        _ => format!("cannot be read: {e}"),
    })?;
    String::from_utf8(json).map_err(|e| format!("is not a tokenizer.json that can be used: {e}"))
}

fn too_large() -> String {
    format!("is larger than {MAX_FILE} bytes")
}

fn build(definition: &str, limit: usize) -> std::result::Result<tokenizers::Tokenizer, String> {
    if definition.len() as u64 > MAX_FILE {
        return Err(too_large());
    }
    let mut tokenizer = guarded(|| tokenizers::Tokenizer::from_bytes(definition))
        .map_err(|cause| format!("is not a tokenizer.json that can be used: {cause}"))?;
    if let ModelWrapper::BPE(bpe) = tokenizer.get_model() {
        if bpe.dropout.is_some_and(|share| share > 0.0) {
            return Err(
                "splits words at random (dropout); set \"dropout\" to null, training has to be repeatable"
                    .into(),
            );
        }
    }
    tokenizer.with_padding(None);
    let truncation = TruncationParams {
        direction: TruncationDirection::Right,
        max_length: limit,
        strategy: TruncationStrategy::LongestFirst,
        stride: 0,
    };
    guarded(|| tokenizer.with_truncation(Some(truncation)).map(|_| ()))?;
    Ok(tokenizer)
}

/// Turns a panic of the library into an error: the file may come from anyone.
fn guarded<T>(step: impl FnOnce() -> tokenizers::Result<T>) -> std::result::Result<T, String> {
    match catch_unwind(AssertUnwindSafe(step)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(e)) => Err(e.to_string()),
        Err(_) => Err("its parts contradict each other".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy_folder::LeRobotConfig;
    use serde_json::{json, Value};

    fn config() -> PolicyConfig {
        let folder = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../tests/fixtures/smolvla_tiny"
        );
        let text = |file: &str| std::fs::read_to_string(format!("{folder}/{file}")).unwrap();
        let (policy, vlm) = (text("policy_config.json"), text("vlm_config.json"));
        let mut config = LeRobotConfig::parse(&policy, Some(&vlm)).unwrap().dims;
        config.max_language_tokens = 4;
        config
    }

    /// A byte-level BPE of a few letters; `Ġ` is the space, `Ċ` the line break.
    fn definition() -> Value {
        json!({
            "version": "1.0", "truncation": null, "padding": null, "added_tokens": [],
            "normalizer": null,
            "pre_tokenizer": {"type": "ByteLevel", "add_prefix_space": false, "trim_offsets": true, "use_regex": true},
            "post_processor": null, "decoder": null,
            "model": {
                "type": "BPE", "dropout": null, "unk_token": null, "continuing_subword_prefix": null,
                "end_of_word_suffix": null, "fuse_unk": false, "byte_fallback": false,
                "vocab": {"r": 0, "e": 1, "d": 2, "Ġ": 3, "Ċ": 4, "re": 5, "red": 6, "Ġred": 7},
                "merges": ["r e", "re d", "Ġ red"]
            }
        })
    }

    fn read(definition: &Value, config: &PolicyConfig) -> Result<TrainedTokenizer> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("tokenizer.json");
        std::fs::write(&path, serde_json::to_vec(definition).unwrap()).unwrap();
        TrainedTokenizer::read(path, config)
    }

    fn tokens(definition: &Value, task: &str) -> Vec<u32> {
        read(definition, &config()).unwrap().tokens(task).unwrap()
    }

    #[test]
    fn merges_apply_and_the_line_break_is_added_once() {
        assert_eq!(tokens(&definition(), "red red"), [6, 7, 4]);
        assert_eq!(tokens(&definition(), "red red\n"), [6, 7, 4]);
        assert_eq!(tokens(&definition(), "reed"), [5, 1, 2, 4]);
        assert_eq!(tokens(&definition(), ""), [4]);
    }

    #[test]
    fn what_is_too_long_is_cut_on_the_right_whatever_the_file_says() {
        // The policy reads four tokens: the line break is cut, too, as in LeRobot.
        assert_eq!(tokens(&definition(), "red red red red red"), [6, 7, 7, 7]);
        let mut other = definition();
        other["truncation"] =
            json!({"direction": "Left", "max_length": 1, "strategy": "LongestFirst", "stride": 0});
        other["padding"] = json!({
            "strategy": {"Fixed": 4}, "direction": "Right", "pad_to_multiple_of": null,
            "pad_id": 0, "pad_type_id": 0, "pad_token": "r"
        });
        assert_eq!(tokens(&other, "red red"), [6, 7, 4]);
    }

    #[test]
    fn special_tokens_are_added_where_the_file_says_so() {
        let mut with_start = definition();
        with_start["added_tokens"] = json!([{
            "id": 8, "content": "<s>", "single_word": false, "lstrip": false, "rstrip": false,
            "normalized": false, "special": true
        }]);
        with_start["post_processor"] = json!({
            "type": "TemplateProcessing",
            "single": [{"SpecialToken": {"id": "<s>", "type_id": 0}}, {"Sequence": {"id": "A", "type_id": 0}}],
            "pair": [{"Sequence": {"id": "A", "type_id": 0}}, {"Sequence": {"id": "B", "type_id": 1}}],
            "special_tokens": {"<s>": {"id": "<s>", "ids": [8], "tokens": ["<s>"]}}
        });
        assert_eq!(tokens(&with_start, "red red"), [8, 6, 7, 4]);
        assert_eq!(tokens(&with_start, "red red red red"), [8, 6, 7, 7]);
    }

    #[test]
    fn more_special_tokens_than_the_policy_reads_are_refused() {
        let mut crowded = definition();
        crowded["added_tokens"] = json!([{
            "id": 8, "content": "<s>", "single_word": false, "lstrip": false, "rstrip": false,
            "normalized": false, "special": true
        }]);
        let start = json!({"SpecialToken": {"id": "<s>", "type_id": 0}});
        let sequence = json!({"Sequence": {"id": "A", "type_id": 0}});
        crowded["post_processor"] = json!({
            "type": "TemplateProcessing",
            "single": [start, start, start, start, start, sequence],
            "pair": [sequence, {"Sequence": {"id": "B", "type_id": 1}}],
            "special_tokens": {"<s>": {"id": "<s>", "ids": [8], "tokens": ["<s>"]}}
        });
        let tokenizer = read(&crowded, &config()).unwrap();
        let error = tokenizer.tokens("red").unwrap_err().to_string();
        assert!(error.contains("more special tokens than the 4"), "{error}");
    }

    #[test]
    fn a_panic_of_the_library_becomes_an_error() {
        let error = guarded::<()>(|| panic!("this is impossible"));
        assert_eq!(error, Err("its parts contradict each other".into()));
    }

    #[test]
    fn an_id_beyond_the_vocabulary_is_named() {
        let mut wide = definition();
        wide["model"]["vocab"]["red"] = 128.into();
        let tokenizer = read(&wide, &config()).unwrap();
        assert_eq!(tokenizer.tokens("reed").unwrap(), [5, 1, 2, 4]);
        let error = tokenizer.tokens("red").unwrap_err().to_string();
        assert!(
            error.contains("token id 128 (\"red\") for \"red\", the policy knows 128 tokens"),
            "{error}"
        );
    }

    #[test]
    fn the_text_of_a_file_gives_the_same_tokens_and_is_held_to_the_same_rules() {
        let config = config();
        let text = definition().to_string();
        let parsed = TrainedTokenizer::parse(&text, &config).unwrap();
        assert_eq!(parsed.definition(), text);
        assert_eq!(parsed.tokens("red red").unwrap(), [6, 7, 4]);
        let refused = |text: &str| match TrainedTokenizer::parse(text, &config) {
            Ok(_) => panic!("was read"),
            Err(e) => e.to_string(),
        };
        let broken = refused("");
        assert!(
            broken.contains("the policy file's tokenizer is not a tokenizer.json"),
            "{broken}"
        );
        let mut random = definition();
        random["model"]["dropout"] = 0.1.into();
        assert!(refused(&random.to_string()).contains("dropout"));
        let long = " ".repeat(MAX_FILE as usize + 1);
        assert!(refused(&long).contains("is larger than"));
    }

    #[test]
    fn files_that_are_no_tokenizer() {
        let config = config();
        let refused = |definition: &Value| match read(definition, &config) {
            Ok(_) => panic!("was read"),
            Err(e) => e.to_string(),
        };
        assert!(refused(&json!({})).contains("tokenizer.json: is not a tokenizer.json"));
        let mut random = definition();
        random["model"]["dropout"] = 0.1.into();
        assert!(refused(&random).contains("dropout"));
        let mut unmergeable = definition();
        unmergeable["model"]["merges"] = json!(["r x"]);
        assert!(refused(&unmergeable).contains("is not a tokenizer.json that can be used"));

        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("none.json");
        let error = TrainedTokenizer::read(&path, &config)
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains("none.json: cannot be read"), "{error}");
        std::fs::File::create(&path)
            .unwrap()
            .set_len(MAX_FILE + 1)
            .unwrap();
        let error = TrainedTokenizer::read(&path, &config)
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains("is larger than"), "{error}");
    }
}
