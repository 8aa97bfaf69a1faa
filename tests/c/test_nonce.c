/* Nonces, with the clock about to wrap, and the random words behind them. */
#include "check.h"
#include "link/nonce.h"

#define VERB 3U
#define NOW  0xFFFFF000U /* 4 ms before the clock wraps */

static void nonces(void) {
    nonce_t n = {0}, other = {0};
    random_t random;
    random_init(&random, 1U);
    CHECK(!nonce_answer(&n, VERB, 0U, NOW)); /* none was asked for */
    CHECK(!nonce_answer(&n, 0U, 0U, 0U));

    uint32_t value = nonce_issue(&n, &random, VERB, 0U, NOW);
    CHECK(value != 0U);
    CHECK(nonce_answer(&n, VERB, value, NOW + NONCE_LIFE_US));
    CHECK(!nonce_answer(&n, VERB, value, NOW + NONCE_LIFE_US)); /* once */

    value = nonce_issue(&n, &random, VERB, 0U, NOW);
    CHECK(!nonce_answer(&n, VERB, value ^ 1U, NOW));
    CHECK(!nonce_answer(&n, VERB, value, NOW)); /* used up by a wrong one, too */

    value = nonce_issue(&n, &random, VERB, 0U, NOW);
    CHECK(!nonce_answer(&n, VERB + 1U, value, NOW)); /* another command's */

    value = nonce_issue(&n, &random, VERB, 0U, NOW);
    CHECK(!nonce_answer(&n, VERB, value, NOW + NONCE_LIFE_US + 1U)); /* too late */

    value = nonce_issue(&n, &random, VERB, 0U, NOW);
    CHECK(value != nonce_issue(&n, &random, VERB, 0U, NOW));
    CHECK(!nonce_answer(&n, VERB, value, NOW)); /* the newest alone counts */

    value = nonce_issue(&n, &random, VERB, 0U, NOW);
    (void)nonce_issue(&other, &random, VERB, 0U, NOW);
    CHECK(nonce_answer(&n, VERB, value, NOW)); /* another link's does not replace it */

    /* Two hosts of one bus: both receive the nonce of the second, which counts for that one alone. */
    (void)nonce_issue(&n, &random, VERB, 7U, NOW);
    value = nonce_issue(&n, &random, VERB, 8U, NOW);
    CHECK(!nonce_answer(&n, VERB, value ^ 7U, NOW));
    value = nonce_issue(&n, &random, VERB, 8U, NOW);
    CHECK(nonce_answer(&n, VERB, value ^ 8U, NOW) && n.asker == 8U);
}

static void random_words(void) {
    random_t a, b;
    for (uint32_t seed = 0U; seed < 1000U; seed++) {
        random_init(&a, seed);
        random_init(&b, seed + 1U);
        CHECK(random_next(&a) != 0U && random_next(&a) != random_next(&b));
        random_stir(&a, a.state); /* would leave nothing */
        CHECK(random_next(&a) != 0U);
    }
    random_init(&a, 7U);
    random_init(&b, 7U);
    random_stir(&a, 1000U);
    random_stir(&b, 1001U);
    CHECK(random_next(&a) != random_next(&b)); /* a frame that came a microsecond later */
}

int main(void) {
    nonces();
    random_words();
    return check_failures != 0;
}
