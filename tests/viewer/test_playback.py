from archerfish.viewer.playback import Film, Playback, advanced, engagement_at, scrubbed, toggled


def test_a_film_goes_on_at_its_pace_and_stops_at_its_end() -> None:
    film = Playback(2.0, pace=0.5)
    assert advanced(film, 1.0).time == 0.5
    end = advanced(film, 100.0)
    assert (end.time, end.playing) == (2.0, False)


def test_a_paused_film_stays_where_it_is() -> None:
    paused = toggled(advanced(Playback(2.0), 0.5))
    assert advanced(paused, 1.0) == paused
    assert advanced(toggled(paused), 1.0).time == 1.5


def test_scrubbing_pauses_within_the_film() -> None:
    assert scrubbed(Playback(2.0), 1.2) == Playback(2.0, 1.2, playing=False)
    assert scrubbed(Playback(2.0), 9.0).time == 2.0
    assert scrubbed(Playback(2.0), -1.0).time == 0.0


def test_a_film_that_is_over_begins_anew() -> None:
    assert toggled(advanced(Playback(2.0), 3.0)) == Playback(2.0)


def test_the_engagement_follows_from_the_time() -> None:
    assert engagement_at(0.0, 1.3, 3) == (0, 0.0)
    assert engagement_at(1.3, 1.3, 3)[0] == 1
    last, since = engagement_at(3.9, 1.3, 3)
    assert last == 2
    assert abs(since - 1.3) < 1e-9


def test_a_film_that_is_being_made_is_followed_unless_it_is_paused() -> None:
    film = Film()
    film.begin(0.0)
    film.grow(0.4)
    assert film.playback.time == 0.4
    film.scrub(0.2)
    film.grow(0.8)
    assert film.playback.time == 0.2
    film.set_pace(0.05)
    film.begin(1.0)
    assert film.playback == Playback(1.0, pace=0.05)


def test_a_film_that_is_over_is_repeated_for_someone_who_comes_late_and_a_paused_one_is_left() -> None:
    film = Film()
    film.begin(1.0)
    film.scrub(0.5)
    film.repeat()
    assert film.playback == Playback(1.0, 0.5, playing=False)
    film.scrub(1.0)
    film.repeat()
    assert film.playback == Playback(1.0)
