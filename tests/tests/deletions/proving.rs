//! Checks of the proving service: nobody holds its places or its connections for nothing, no claim is proven twice because a client went away,
//! no node waits for a proof in vain, and one prover runs on a machine.

use crate::Removal;

const SERVER: &str = "prover/src/service/server.rs";
const MADE: &str = "prover/src/service/made.rs";
const INCOMING: &str = "tls/src/incoming.rs";
const LOCK: &str = "prover/src/machine/lock.rs";

const fn proving(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        check,
        file,
        replacements,
        package: "zk0-prover",
        target: "service",
        test,
    }
}

pub const REMOVALS: &[Removal] = &[
    proving(
        "a client of the proving service that is silent is given up",
        "prover/src/service/upload.rs",
        &[(
            "parts.timeout(silence)",
            "parts.timeout(silence.max(Duration::from_secs(3600)))",
        )],
        "who_sends_nothing_or_too_slowly_is_given_up",
    ),
    proving(
        "a client of the proving service that is slow is given up",
        SERVER,
        &[(
            "timeout(self.patience.whole, self.received",
            "timeout(self.patience.whole.max(Duration::from_secs(3600)), self.received",
        )],
        "who_sends_nothing_or_too_slowly_is_given_up",
    ),
    proving(
        "a proving service that stops waits for no private input",
        SERVER,
        &[(
            "            _ = stopping.wait_for(|stopping| *stopping) => Err(Status",
            "            () = std::future::pending() => Err(Status",
        )],
        "a_service_that_stops_waits_for_no_private_input",
    ),
    proving(
        "a proving service that stops waits for no client that takes nothing",
        SERVER,
        &[(
            "            sleep(ENDING).await;\n",
            "            std::future::pending::<()>().await;\n",
        )],
        "a_service_that_stops_does_not_wait_until_a_proof_is_taken",
    ),
    proving(
        "as many claims wait for the proving service as the queue is long",
        SERVER,
        &[("Semaphore::new(queue + 1)", "Semaphore::new(queue + 2)")],
        "a_full_queue_refuses_and_accepts_again_when_a_proof_is_done",
    ),
    proving(
        "a proof of another claim is neither handed out nor kept",
        SERVER,
        &[(
            "if proof.public_values != expected.public_values {",
            "if false {",
        )],
        "a_proof_of_another_claim_is_not_handed_out",
    ),
    proving(
        "a proof is kept for a client that went away",
        SERVER,
        &[("prover.made.keep(of, proof.clone());", "let _ = of;")],
        "a_proof_whose_client_went_away_is_there_when_it_asks_again",
    ),
    proving(
        "a client that asks again waits for the proof that is being made, and for nothing else",
        SERVER,
        &[
            (
                "if let Some(place) = shared.made.making(of) {",
                "if let Some(place) = shared.made.making(of).filter(|_| false) {",
            ),
            (
                "proof = shared.made.until(of) =>",
                "proof = shared.made.until(of), if false =>",
            ),
        ],
        "who_asks_for_the_proof_that_is_being_made_waits_for_nothing_else",
    ),
    proving(
        "a request that comes twice is answered as soon as its proof is there",
        SERVER,
        &[(
            "proof = shared.made.until(of) =>",
            "proof = shared.made.until(of), if false =>",
        )],
        "a_request_that_comes_twice_is_answered_by_one_proof",
    ),
    proving(
        "a full queue refuses nobody whose proof is there or being made",
        SERVER,
        &[("match self.shared.made.has(of) {", "match false {")],
        "a_full_queue_refuses_nobody_whose_proof_is_there_or_being_made",
    ),
    proving(
        "who waits for a proof that fails needs a place in the queue",
        SERVER,
        &[(
            "self.slot.is_none().then(|| shared.slot())",
            "false.then(|| shared.slot())",
        )],
        "who_waits_for_a_proof_that_fails_needs_a_place_as_everybody_does",
    ),
    proving(
        "a proof that nobody took outlives proofs that are taken",
        MADE,
        &[("filter(|kept| !kept.taken)", "filter(|_| false)")],
        "a_proof_that_nobody_took_outlives_those_that_are_taken",
    ),
    proving(
        "a kept proof is for the same buffers alone",
        MADE,
        &[(
            "            hasher.update((buffer.len() as u64).to_le_bytes());\n",
            "",
        )],
        "a_proof_is_kept_for_the_same_request_alone",
    ),
    proving(
        "a kept proof is for the same program alone",
        MADE,
        &[("hasher.update(mode.to_le_bytes());", "let _ = mode;")],
        "a_proof_is_kept_for_the_same_request_alone",
    ),
    proving(
        "a silent connection to the proving service is cut",
        INCOMING,
        &[(
            ".poll(context).is_ready() {",
            ".poll(context).is_ready() && false {",
        )],
        "who_connects_and_says_nothing_is_cut",
    ),
    proving(
        "a connection whose first bytes came in time is not cut",
        INCOMING,
        &[(
            "if beginning.come >= PREFACE_BYTES {",
            "if beginning.come >= PREFACE_BYTES && beginning.due.as_mut().poll(context).is_pending() {",
        )],
        "who_began_in_time_is_not_cut_by_a_service_that_looks_late",
    ),
    proving(
        "the connection of a client that is gone is cut",
        SERVER,
        &[(
            ".http2_keepalive_interval(Some(silence))",
            ".http2_keepalive_interval(None)",
        )],
        "a_client_that_is_not_there_any_more_is_cut",
    ),
    proving(
        "the proving service has a bounded number of connections",
        INCOMING,
        &[(
            "Semaphore::new(bounds.most.max(1))",
            "Semaphore::new(Semaphore::MAX_PERMITS)",
        )],
        "connections_beyond_the_bound_wait_until_one_ends",
    ),
    proving(
        "a proving service that may open no file does not spin",
        INCOMING,
        &[(
            "sleep(Duration::from_millis(100)).await;",
            "tokio::task::yield_now().await;",
        )],
        "a_service_that_may_open_no_file_waits_until_it_may",
    ),
    proving(
        "provers with temporary folders of their own lock the same thing",
        LOCK,
        &[(
            "const SHARED_MEMORY: &str = \"/dev/shm\";",
            "const SHARED_MEMORY: &str = \"/missing\";",
        )],
        "a_prover_sees_one_that_has_another_temporary_folder",
    ),
    proving(
        "a link in the place of the prover's lock is not followed",
        LOCK,
        &[("OFlags::NOFOLLOW | ", "")],
        "a_link_in_the_place_of_the_lock_is_not_followed",
    ),
    proving(
        "a pipe in the place of the prover's lock keeps nobody waiting",
        LOCK,
        &[(" | OFlags::NONBLOCK", "")],
        "a_pipe_in_the_place_of_the_lock_keeps_nobody_waiting",
    ),
    proving(
        "other users can lock the prover's lock",
        LOCK,
        &[(
            "file.set_permissions(Permissions::from_mode(0o644))?;",
            "let _ = Permissions::from_mode(0o644);",
        )],
        "other_users_can_lock_the_same_file",
    ),
    Removal {
        check: "a node does not wait for a proof that would come too late",
        file: "node/src/turn/proving.rs",
        replacements: &[(
            "() = submissions_end(node, opened) =>",
            "() = submissions_end(node, opened), if false =>",
        )],
        package: "zk0-node",
        target: "lying_aggregator",
        test: "a_node_waits_for_no_proof_that_would_come_too_late",
    },
];
