//! The sources of randomness against published values: RFC 9381's test vectors, and rounds of drand's quicknet.

use curve25519_dalek::edwards::{CompressedEdwardsY, EdwardsPoint};
use ed25519_dalek::SigningKey;
use sha2::{Digest as _, Sha512};
use zk0_circuits::vm::digest::sha256;
use zk0_protocol::challenge::drand::{BeaconSignature, DrandChain};
use zk0_protocol::challenge::vrf::VrfProof;

fn bytes<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    hex::decode_to_slice(text, &mut bytes).unwrap();
    bytes
}

/// RFC 9381, appendix B.3, examples 16 to 18: secret key, public key, input, proof, output.
const VRF: [[&str; 5]; 3] = [
    [
        "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60",
        "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a",
        "",
        "8657106690b5526245a92b003bb079ccd1a92130477671f6fc01ad16f26f723f26f8a57ccaed74ee1b190bed1f479d9727d2d0f9b005a6e456a35d4fb0daab1268a1b0db10836d9826a528ca76567805",
        "90cf1df3b703cce59e2a35b925d411164068269d7b2d29f3301c03dd757876ff66b71dda49d2de59d03450451af026798e8f81cd2e333de5cdf4f3e140fdd8ae",
    ],
    [
        "4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb",
        "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c",
        "72",
        "f3141cd382dc42909d19ec5110469e4feae18300e94f304590abdced48aed5933bf0864a62558b3ed7f2fea45c92a465301b3bbf5e3e54ddf2d935be3b67926da3ef39226bbc355bdc9850112c8f4b02",
        "eb4440665d3891d668e7e0fcaf587f1b4bd7fbfe99d0eb2211ccec90496310eb5e33821bc613efb94db5e5b54c70a848a0bef4553a41befc57663b56373a5031",
    ],
    [
        "c5aa8df43f9f837bedb7442f31dcb7b166d38535076f094b85ce3a2e0b4458f7",
        "fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025",
        "af82",
        "9bc0f79119cc5604bf02d23b4caede71393cedfbb191434dd016d30177ccbf8096bb474e53895c362d8628ee9f9ea3c0e52c7a5c691b6c18c9979866568add7a2d41b00b05081ed0f58ee5e31b3a970e",
        "645427e5d00c62a23fb703732fa5d892940935942101e456ecca7bb217c61c452118fec1219202a0edcf038bb6373241578be7217ba85a2687f7a0310b2df19f",
    ],
];

#[test]
fn the_vrf_is_that_of_the_rfc() {
    for [secret, public, input, proof, output] in VRF {
        let (key, public) = (SigningKey::from_bytes(&bytes(secret)), bytes(public));
        assert_eq!(key.verifying_key().to_bytes(), public);
        let input = hex::decode(input).unwrap();
        let made = VrfProof::of(&key, &input);
        assert_eq!(made, VrfProof(bytes(proof)));
        assert_eq!(made.verify(&public, &input), Some(bytes(output)));
        assert_eq!(made.output(), Some(bytes(output)));
    }
}

#[test]
fn a_proof_is_for_one_key_and_one_input_and_every_bit_of_it_matters() {
    let key = SigningKey::from_bytes(&[3; 32]);
    let public = key.verifying_key().to_bytes();
    let proof = VrfProof::of(&key, b"input");
    assert!(proof.verify(&public, b"input").is_some());
    assert_eq!(proof.verify(&public, b"another"), None);
    let other = SigningKey::from_bytes(&[4; 32]).verifying_key().to_bytes();
    assert_eq!(proof.verify(&other, b"input"), None);
    for position in 0..80 {
        for bit in 0..8 {
            let mut changed = proof;
            changed.0[position] ^= 1 << bit;
            assert_eq!(changed.verify(&public, b"input"), None, "{position} {bit}");
        }
    }
}

/// RFC 9381's `ECVRF_encode_to_curve_try_and_increment`, for a proof that nobody's key makes.
fn on_the_curve(key: &[u8; 32], input: &[u8]) -> EdwardsPoint {
    let mut tries = (0..=u8::MAX).filter_map(|counter| {
        let hash = Sha512::new()
            .chain_update([3, 1])
            .chain_update(key)
            .chain_update(input)
            .chain_update([counter, 0])
            .finalize();
        let point = CompressedEdwardsY(hash[..32].try_into().unwrap()).decompress()?;
        Some(point.mul_by_cofactor())
    });
    tries.next().unwrap()
}

#[test]
fn a_key_whose_output_anybody_knows_is_refused() {
    // The secret is 0, so the public key and the proof's point are the neutral element, whatever the input is.
    let neutral = EdwardsPoint::default().compress();
    let (public, input) = (neutral.to_bytes(), b"input");
    let shown = [
        neutral,
        on_the_curve(&public, input).compress(),
        neutral,
        neutral,
        neutral,
    ];
    let mut hash = Sha512::new().chain_update([3, 2]);
    shown.iter().for_each(|point| hash.update(point.as_bytes()));
    hash.update([0]);
    let mut proof = [0; 80];
    proof[..32].copy_from_slice(neutral.as_bytes());
    proof[32..48].copy_from_slice(&hash.finalize()[..16]);
    assert!(VrfProof(proof).output().is_some());
    assert_eq!(VrfProof(proof).verify(&public, input), None);
}

/// Rounds of quicknet as its servers publish them: round, signature, randomness.
const QUICKNET: [(u64, &str, &str); 3] = [
    (
        1,
        "b55e7cb2d5c613ee0b2e28d6750aabbb78c39dcc96bd9d38c2c2e12198df95571de8e8e402a0cc48871c7089a2b3af4b",
        "1466a6cd24e327188770752f6134001c64d6efcc590ccc26b721611ad96f165a",
    ),
    (
        1000,
        "b44679b9a59af2ec876b1a6b1ad52ea9b1615fc3982b19576350f93447cb1125e342b73a8dd2bacbe47e4b6b63ed5e39",
        "fe290beca10872ef2fb164d2aa4442de4566183ec51c56ff3cd603d930e54fdd",
    ),
    (
        657_413,
        "b713718a38ae728dfd477991af2822e08d2f305e47718cef9f7848ce4050e7be41076862b98fad56e91a6b85b89cd97b",
        "fc1873a13f3545aeade8401532ef5519920652eee6b0d2b19ca12643b87b3587",
    ),
];

#[test]
fn published_rounds_of_quicknet_verify() {
    let chain = DrandChain::quicknet();
    chain.check().unwrap();
    for (round, signature, randomness) in QUICKNET {
        let signature: BeaconSignature = bytes(signature);
        assert!(chain.signed(round, &signature), "round {round}");
        assert_eq!(sha256(&[&signature]).to_string(), randomness);
        assert!(!chain.signed(round + 1, &signature));
        let mut changed = signature;
        changed[47] ^= 1;
        assert!(!chain.signed(round, &changed));
    }
    // The first signature, negated, is a point of the group, and no signature.
    let mut negated: BeaconSignature = bytes(QUICKNET[0].1);
    negated[0] ^= 0x20;
    assert!(!chain.signed(1, &negated));
    // The point at infinity.
    let mut infinity = [0; 48];
    infinity[0] = 0xc0;
    assert!(!chain.signed(1, &infinity));
}

#[test]
fn a_signature_of_another_chain_does_not_verify() {
    let mut chain = DrandChain::quicknet();
    // The generator of G2: a valid key that is not quicknet's.
    chain.public_key = bytes("93e02b6052719f607dacd3a088274f65596bd0d09920b61ab5da61bbdc7f5049334cf11213945d57e5ac7d055d042b7e024aa2b2f08f0a91260805272dc51051c6e47ad4fa403b02b4510b647ae3d1770bac0326a805bbefd48056c8c121bdb8");
    chain.check().unwrap();
    let (round, signature, _) = QUICKNET[1];
    assert!(!chain.signed(round, &bytes(signature)));
}

#[test]
fn a_chain_whose_signatures_anybody_makes_is_refused() {
    let mut infinity = [0; 96];
    infinity[0] = 0xc0;
    let chain = DrandChain {
        public_key: infinity,
        ..DrandChain::quicknet()
    };
    let refused = chain.check().unwrap_err();
    assert!(refused.starts_with("public_key c0"), "{refused}");
    let mut signature = [0; 48];
    signature[0] = 0xc0;
    assert!(!chain.signed(1, &signature));
}

#[test]
fn the_round_is_the_first_one_after_the_closing_and_its_margin() {
    let chain = DrandChain {
        margin_ms: 60_000,
        ..DrandChain::quicknet()
    };
    let genesis_ms = chain.genesis_s * 1000;
    assert_eq!(chain.time_ms(1), genesis_ms);
    for closed_ms in (genesis_ms - 70_000..genesis_ms + 10_000).step_by(250) {
        let round = chain.round_after(closed_ms);
        assert!(chain.time_ms(round) > closed_ms + 60_000);
        let before = round.checked_sub(1).filter(|before| *before > 0);
        let known = before.is_none_or(|before| chain.time_ms(before) <= closed_ms + 60_000);
        assert!(known, "an earlier round is later than the margin, too");
    }
    // Nothing overflows.
    assert!(chain.round_after(u64::MAX) > 1);
    chain.time_ms(u64::MAX);
}

#[test]
fn a_chain_reads_as_json_with_hexadecimal_keys() {
    let chain = DrandChain::quicknet();
    let text = serde_json::to_string(&chain).unwrap();
    assert!(text.contains("52db9ba70e0cc0f6eaf7803dd07447a1f5477735fd3f661792ba94600c84e971"));
    assert_eq!(serde_json::from_str::<DrandChain>(&text).unwrap(), chain);
    let short = text.replace("52db9b", "52db");
    assert!(serde_json::from_str::<DrandChain>(&short).is_err());
}
