% Adapter: n4sid of Octave's control package, with its default horizon, and with as many block rows as a variant names.
% octave-cli octave_fit.m CASE.json MODELS.json; what the files hold is said in protocol.py.

1;

function [model, seconds] = identify (case_, options)
  start = cputime ();
  data = iddata (case_.output, case_.inputs, case_.sample_period_s);
  model = n4sid (data, case_.order, options{:});
  seconds = cputime () - start;
endfunction

function entry = attempt (case_, variant, options, later_fits)
  entry.variant = variant;
  try
    [model, entry.first_seconds] = identify (case_, options);
    later = entry.first_seconds(later_fits == 0);
    while (numel (later) < later_fits && sum (later) < 2)
      [~, later(end + 1)] = identify (case_, options);
    endwhile
    entry.seconds = min (later);
    [A, B, C, D] = ssdata (model);
    % A scalar or a single row would lose its brackets in JSON, so the shapes travel beside the numbers.
    entry.A = num2cell (A, 2); entry.B = num2cell (B, 2); entry.C = num2cell (C, 2); entry.D = num2cell (D, 2);
  catch problem
    entry.error = problem.message;
  end_try_catch
endfunction

function models = attempts (case_, variants, later_fits)
  models = {};
  for index = 1:numel (variants)
    options = {};
    if (! strcmp (variants{index}, "default s"))
      options = {"s", sscanf(variants{index}, "s = %d")};
    endif
    models{end + 1} = attempt (case_, variants{index}, options, later_fits);
  endfor
endfunction

function main (source, target)
  pkg load control
  facts = jsondecode (fileread (source));
  if (isfield (facts, "cases"))
    models = {};
    for index = 1:numel (facts.cases)
      models{end + 1} = attempts (facts.cases(index), facts.variants, 0);
    endfor
  else
    models = attempts (facts, {"default s", "s = 25"}, 5);
  endif
  file = fopen (target, "w");
  fputs (file, jsonencode (models));
  fclose (file);
endfunction

arguments = argv ();
main (arguments{end - 1}, arguments{end});
