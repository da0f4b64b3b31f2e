"""Whether parts' outputs keep their contracts; the callers that report a breach find its details."""

from __future__ import annotations

from swarmsim.kernels.compiling import njit


@njit(cache=True)
def links_hold(links, alive):
    """Whether links (m, 2) run among different live robots, sorted by receiver, then sender, each once."""
    robots = len(alive)
    last = -1
    for m in range(len(links)):
        receiver, sender = links[m, 0], links[m, 1]
        if not (0 <= receiver < robots and 0 <= sender < robots) or receiver == sender:
            return False
        key = receiver * robots + sender
        if not (alive[receiver] and alive[sender]) or key <= last:
            return False
        last = key
    return True


@njit(cache=True)
def letters_hold(letters, robots, iteration):
    """Whether letters (m, 4) are of these robots, sent by now, and sorted by receiver, sender and iteration sent."""
    for m in range(len(letters)):
        if not (0 <= letters[m, 0] < robots and 0 <= letters[m, 1] < robots) or letters[m, 2] > iteration:
            return False
        if m > 0:
            for column in range(3):
                if letters[m, column] != letters[m - 1, column]:
                    if letters[m, column] < letters[m - 1, column]:
                        return False
                    break
    return True


@njit(cache=True)
def messages_hold(ends, sizes, items):
    """Whether the ends (n,) of messages rise to the number of items, and no size (n,) is negative."""
    last = 0
    for i in range(len(ends)):
        if ends[i] < last or sizes[i] < 0:
            return False
        last = ends[i]
    return last == items


@njit(cache=True)
def counts_hold(counts, most):
    """Whether all counts (n,) lie between 0 and `most`."""
    for count in counts:
        if not 0 <= count <= most:
            return False
    return True


@njit(cache=True)
def audit(changes, shown, known, known_words, observed_words, turn):
    """Whether changes (c, 3) of maps claim only what was `shown` (n, cells), and lead to what is observed.

    Updates `known` (n, cells); `known_words` and, for the maps, `observed_words` are views with eight cells per word.
    Maps are compared in turns, an eighth of them and one more in each `turn`. Gives 0 if all is well; 1 and a row of
    `changes` with an unknown robot, cell or state; 2 and a row that claims an unseen cell; 3 and a robot whose map
    differs from its changes.
    """
    robots, cells = known.shape
    for k in range(len(changes)):
        robot, cell, state = changes[k, 0], changes[k, 1], changes[k, 2]
        if not (0 <= robot < robots and 0 <= cell < cells and 0 <= state <= 2):
            return 1, k
        if state > 0 and not shown[robot, cell]:
            return 2, k
        known[robot, cell] = state > 0
    some = min(robots, robots // 8 + 1)
    for place in range(turn * some, (turn + 1) * some):
        i = place % robots
        differ = 0
        for w in range(known_words.shape[1]):
            differ |= known_words[i, w] ^ observed_words[i, w]
        if differ != 0:
            return 3, i
    return 0, 0
