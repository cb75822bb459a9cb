//! A request's terms in an auction: whom it names, and its maximum price.

use sp1_sdk::network::proto::{types, GetProofRequestParamsResponse};
use sp1_sdk::network::{Address, DEFAULT_MAX_PRICE_PER_PGU_BUFFER};

/// A request's terms; empty outside of auctions.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Bid {
    pub auctioneer: Address,
    pub executor: Address,
    pub verifier: Address,
    pub treasury: Address,
    pub base_fee: u64,
    /// For each unit of the prover's gas.
    pub max_price: u64,
    pub domain: Vec<u8>,
}

impl Bid {
    /// The network's suggestion, at a price up to a fifth higher, as in SP1's client, so that a prover takes the request although prices
    /// move.
    pub fn suggested(params: GetProofRequestParamsResponse) -> Result<Self, String> {
        let GetProofRequestParamsResponse::Auction(params) = params else {
            return Err("it holds no auctions".into());
        };
        let types::GetProofRequestParamsResponse {
            auctioneer,
            executor,
            verifier,
            treasury,
            base_fee,
            max_price_per_pgu,
            tick_size,
            domain,
            ..
        } = params;
        let suggested = number("max_price_per_pgu", &max_price_per_pgu)?;
        let higher = u128::from(suggested) * u128::from(DEFAULT_MAX_PRICE_PER_PGU_BUFFER) / 100;
        let price = u64::try_from(higher).unwrap_or(suggested);
        Ok(Self {
            auctioneer: address("auctioneer", &auctioneer)?,
            executor: address("executor", &executor)?,
            verifier: address("verifier", &verifier)?,
            treasury: address("treasury", &treasury)?,
            base_fee: number("base_fee", &base_fee)?,
            // Prices are multiples of the auction's tick; 0 means no tick.
            max_price: price - price % tick_size.max(1),
            domain,
        })
    }
}

fn address(name: &str, bytes: &[u8]) -> Result<Address, String> {
    Address::try_from(bytes).map_err(|_| {
        let count = bytes.len();
        format!("its {name} has {count} bytes, and an address has 20")
    })
}

fn number(name: &str, text: &str) -> Result<u64, String> {
    text.parse()
        .map_err(|error| format!("its {name} is '{text}': {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn params() -> types::GetProofRequestParamsResponse {
        types::GetProofRequestParamsResponse {
            domain: vec![1; 32],
            auctioneer: vec![2; 20],
            executor: vec![3; 20],
            verifier: vec![4; 20],
            treasury: vec![5; 20],
            max_price_per_pgu: "1000".into(),
            base_fee: "7".into(),
            tick_size: 500,
            ..Default::default()
        }
    }

    #[test]
    fn a_bid_is_a_fifth_above_the_suggested_price_and_a_multiple_of_the_tick() {
        let bid = Bid::suggested(params().into()).unwrap();
        assert_eq!((bid.max_price, bid.base_fee), (1_000, 7));
        assert_eq!(bid.treasury, Address::repeat_byte(5));
        let mut params = params();
        params.tick_size = 0;
        let bid = Bid::suggested(params.into()).unwrap();
        assert_eq!(bid.max_price, 1_200);
    }

    #[test]
    fn a_suggestion_without_sense_is_an_error_that_names_it() {
        let mut short = params();
        short.verifier.pop();
        let mut worded = params();
        worded.base_fee = "a lot".into();
        for (params, name) in [(short, "verifier"), (worded, "base_fee")] {
            let error = Bid::suggested(params.into()).unwrap_err();
            assert!(error.contains(name), "{error}");
        }
    }
}
