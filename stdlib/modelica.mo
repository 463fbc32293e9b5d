package Modelica "Elements of Modelica's library that its own text leaves to C, or to loops over what changes: in lmo, under their names"
  package Math
    package Vectors
      function interpolate "Interpolate linearly in a vector; beyond its ends the first and the last line go on"
        input Real x[:] "Abscissas, increasing";
        input Real y[size(x, 1)] "Ordinates";
        input Real xi "Where";
        input Integer iLast = 1;
        output Real yi;
        output Integer iNew;
      protected
        Integer n = size(x, 1);
      algorithm
        yi := y[1];
        iNew := 1;
        if n > 1 then
          yi := y[1] + (y[2] - y[1])*(xi - x[1])/(x[2] - x[1]);
        end if;
        for k in 2:n - 1 loop
          yi := smooth(0, if xi >= x[k] then y[k] + (y[k + 1] - y[k])*(xi - x[k])/(x[k + 1] - x[k]) else yi);
          iNew := noEvent(if xi >= x[k] then k else iNew);
        end for;
      end interpolate;
    end Vectors;
    package Matrices
      package LAPACK
        function dgesv "Solve linear equations with several right sides, by Gauss's elimination with pivots by columns"
          input Real A[:, size(A, 1)];
          input Real B[size(A, 1), :];
          output Real X[size(A, 1), size(B, 2)];
          output Integer info "0, or the column without a pivot";
        protected
          Integer n = size(A, 1);
          Real M[size(A, 1), size(A, 1)] = A;
          Real row[size(A, 1)];
          Real right[size(B, 2)];
          Real f;
          Integer p;
        algorithm
          X := B;
          info := 0;
          for k in 1:n loop
            p := k;
            for i in k + 1:n loop
              if abs(M[i, k]) > abs(M[p, k]) then
                p := i;
              end if;
            end for;
            if M[p, k] == 0 then
              info := k;
              return;
            end if;
            row := M[p, :];
            right := X[p, :];
            M[p, :] := M[k, :];
            X[p, :] := X[k, :];
            M[k, :] := row;
            X[k, :] := right;
            for i in k + 1:n loop
              f := M[i, k]/M[k, k];
              M[i, :] := M[i, :] - f*row;
              X[i, :] := X[i, :] - f*right;
            end for;
          end for;
          for k in n:-1:1 loop
            for j in k + 1:n loop
              X[k, :] := X[k, :] - M[k, j]*X[j, :];
            end for;
            X[k, :] := X[k, :]/M[k, k];
          end for;
        end dgesv;
        function dgesv_vec "Solve linear equations"
          input Real A[:, size(A, 1)];
          input Real b[size(A, 1)];
          output Real x[size(A, 1)];
          output Integer info;
        protected
          Real X[size(A, 1), 1];
        algorithm
          (X, info) := dgesv(A, matrix(b));
          x := X[:, 1];
        end dgesv_vec;
        function dgglse_vec "Find the x with B*x = d that minimizes |A*x - c|: x, what A*x misses, and multipliers in one system"
          input Real A[:, :];
          input Real c[size(A, 1)];
          input Real B[:, size(A, 2)];
          input Real d[size(B, 1)];
          output Real x[size(A, 2)];
          output Integer info;
        protected
          Integer m = size(A, 1);
          Integer n = size(A, 2);
          Integer p = size(B, 1);
          Real found[size(A, 1) + size(A, 2) + size(B, 1)];
        algorithm
          (found, info) := dgesv_vec(
            [identity(m), A, zeros(m, p); transpose(A), zeros(n, n), transpose(B); zeros(p, m), B, zeros(p, p)],
            cat(1, c, zeros(n), d));
          x := found[m + 1:m + n];
        end dgglse_vec;
      end LAPACK;
    end Matrices;
    package Random
      package Generators
        package Xorshift64star
          function random "Draw with xorshift64*"
            input Integer stateIn[2];
            output Real result "In (0, 1]";
            output Integer stateOut[2];
          algorithm
            result := __lmoc_random(stateIn);
            stateOut := __lmoc_random_state(stateIn);
          end random;
        end Xorshift64star;
        package Xorshift128plus
          function random "Draw with xorshift128+"
            input Integer stateIn[4];
            output Real result "In (0, 1]";
            output Integer stateOut[4];
          algorithm
            result := __lmoc_random(stateIn);
            stateOut := __lmoc_random_state(stateIn);
          end random;
        end Xorshift128plus;
        package Xorshift1024star
          function random "Draw with xorshift1024*"
            input Integer stateIn[33];
            output Real result "In (0, 1]";
            output Integer stateOut[33];
          algorithm
            result := __lmoc_random(stateIn);
            stateOut := __lmoc_random_state(stateIn);
          end random;
        end Xorshift1024star;
      end Generators;
      package Utilities
        function automaticGlobalSeed "The same in each run: what a model gives does not depend on the clock"
          output Integer seed = 1;
        algorithm
        end automaticGlobalSeed;
        function initializeImpureRandom "The seed itself, which is the name of the generator that begins with it"
          input Integer seed;
          output Integer id = seed;
        algorithm
        end initializeImpureRandom;
        function impureRandom "Draw with xorshift1024*, whose state is hidden: in one when-equation of a model"
          input Integer id;
          output Real y "In (0, 1]";
        algorithm
          y := __lmoc_impure_random(Modelica.Math.Random.Utilities.initialStateWithXorshift64star(715827883, id, 33));
        end impureRandom;
      end Utilities;
    end Random;
  end Math;
  package Utilities
    package Streams
      function error "End with a message"
        input String string;
      algorithm
        assert(false, string);
      end error;
    end Streams;
    package Strings
      function length "Number of characters of a text"
        input String string;
        output Integer result;
      algorithm
        result := __lmoc_length(string);
      end length;

      function substring "Characters of a text from one place to another, both included"
        input String string;
        input Integer startIndex(min = 1);
        input Integer endIndex(min = 1);
        output String result;
      algorithm
        result := __lmoc_substring(string, startIndex, endIndex);
      end substring;

      function hashString "A whole number for a text"
        input String string;
        output Integer hash;
      algorithm
        hash := __lmoc_hash(string);
      end hashString;
    end Strings;
  end Utilities;
  package Blocks
    package Sources
      block CombiTimeTable "Tables over time: lines or steps between their points"
        extends Modelica.Blocks.Interfaces.MO(final nout = max([size(columns, 1); size(offset, 1)]));
        parameter Boolean tableOnFile = false;
        parameter Real table[:, :] = fill(0.0, 0, 2) "Times, then one column for each output";
        parameter String tableName = "NoName";
        parameter String fileName = "NoName";
        parameter Boolean verboseRead = true;
        parameter Integer columns[:] = 2:size(table, 2);
        parameter Modelica.Blocks.Types.Smoothness smoothness = Modelica.Blocks.Types.Smoothness.LinearSegments;
        parameter Modelica.Blocks.Types.Extrapolation extrapolation = Modelica.Blocks.Types.Extrapolation.LastTwoPoints;
        parameter Real timeScale(unit = "s") = 1;
        parameter Real offset[:] = {0};
        parameter Real startTime(unit = "s") = 0;
        parameter Real shiftTime(unit = "s") = startTime;
        parameter Modelica.Blocks.Types.TimeEvents timeEvents = Modelica.Blocks.Types.TimeEvents.Always;
        parameter Boolean verboseExtrapolation = false;
        final parameter Real t_min(unit = "s") = t_minScaled*timeScale;
        final parameter Real t_max(unit = "s") = t_maxScaled*timeScale;
        final parameter Real t_minScaled = if size(table, 1) > 0 then table[1, 1] else 0;
        final parameter Real t_maxScaled = if size(table, 1) > 0 then table[size(table, 1), 1] else 0;
      protected
        final parameter Integer m = size(table, 1);
        final parameter Real p_offset[nout] = if size(offset, 1) == 1 then ones(nout)*offset[1] else offset;
        final parameter Boolean lines = smoothness == Modelica.Blocks.Types.Smoothness.LinearSegments;
        final parameter Boolean hold = extrapolation == Modelica.Blocks.Types.Extrapolation.HoldLastPoint or not lines;
        final parameter Boolean periodic = extrapolation == Modelica.Blocks.Types.Extrapolation.Periodic;
        final parameter Real rise[max(m - 1, 0), nout] =
          {{if lines and table[k + 1, 1] > table[k, 1] then
              (table[k + 1, columns[i]] - table[k, columns[i]])/max(table[k + 1, 1] - table[k, 1], 1e-300)
            else 0 for i in 1:nout} for k in 1:max(m - 1, 0)};
        Boolean begun = time >= startTime;
        Boolean from[max(m, 1)] "behind which points the time is";
        Real u "where the table is looked at";
      equation
        assert(not tableOnFile, "CombiTimeTable: tables on files are not available yet");
        assert(m > 0, "CombiTimeTable: the table is empty");
        assert(lines or smoothness == Modelica.Blocks.Types.Smoothness.ConstantSegments,
          "CombiTimeTable: of the kinds of smoothness LinearSegments and ConstantSegments are available");
        if periodic and m > 1 then
          u = t_minScaled + mod(time/timeScale - shiftTime/timeScale - t_minScaled, t_maxScaled - t_minScaled);
          for k in 1:m loop
            from[k] = t_minScaled + mod(time/timeScale - shiftTime/timeScale - t_minScaled, t_maxScaled - t_minScaled)
              >= table[k, 1];
          end for;
        else
          u = (time - shiftTime)/timeScale;
          for k in 1:m loop
            from[k] = time >= shiftTime + timeScale*table[k, 1];
          end for;
        end if;
        for i in 1:nout loop
          if m == 1 then
            y[i] = p_offset[i] + (if begun then table[1, columns[i]] else 0);
          else
            y[i] = p_offset[i] + (if not begun then 0
              elseif hold and not from[1] then table[1, columns[i]]
              elseif hold and from[m] then table[m, columns[i]]
              else sum(if (k == 1 or from[k]) and (k == m - 1 or not from[k + 1]) then
                  (if table[k + 1, 1] > table[k, 1] then table[k, columns[i]] else table[k + 1, columns[i]])
                  + rise[k, i]*(u - table[k, 1]) else 0 for k in 1:m - 1));
          end if;
        end for;
      end CombiTimeTable;
      block TimeTable "A line through points over time, which may jump; before the start the offset, after the last point the last line"
        extends Modelica.Blocks.Interfaces.SignalSource;
        parameter Real table[:, 2] = fill(0.0, 0, 2) "Times and values";
        parameter Real timeScale(unit = "s") = 1;
        parameter Real shiftTime(unit = "s") = startTime;
      protected
        CombiTimeTable lines(final table = table, final columns = {2}, final timeScale = timeScale, final offset = {offset},
          final startTime = startTime, final shiftTime = shiftTime);
      equation
        y = lines.y[1];
      end TimeTable;
    end Sources;
    package Tables
      block CombiTable1Ds "Tables over one input: lines or steps between their points"
        extends Modelica.Blocks.Interfaces.SIMO(final nout = size(columns, 1));
        parameter Boolean tableOnFile = false;
        parameter Real table[:, :] = fill(0.0, 0, 2);
        parameter String tableName = "NoName";
        parameter String fileName = "NoName";
        parameter Boolean verboseRead = true;
        parameter Integer columns[:] = 2:size(table, 2);
        parameter Modelica.Blocks.Types.Smoothness smoothness = Modelica.Blocks.Types.Smoothness.LinearSegments;
        parameter Modelica.Blocks.Types.Extrapolation extrapolation = Modelica.Blocks.Types.Extrapolation.LastTwoPoints;
        parameter Boolean verboseExtrapolation = false;
        final parameter Real u_min = table[1, 1];
        final parameter Real u_max = table[size(table, 1), 1];
      protected
        final parameter Integer m = size(table, 1);
        final parameter Boolean lines = smoothness == Modelica.Blocks.Types.Smoothness.LinearSegments;
        final parameter Boolean hold = extrapolation == Modelica.Blocks.Types.Extrapolation.HoldLastPoint or not lines;
        Real at = if extrapolation == Modelica.Blocks.Types.Extrapolation.Periodic then u_min + mod(u - u_min, u_max - u_min)
          elseif hold then noEvent(min(max(u, u_min), u_max)) else u;
      equation
        assert(not tableOnFile, "CombiTable1Ds: tables on files are not available yet");
        assert(lines or smoothness == Modelica.Blocks.Types.Smoothness.ConstantSegments,
          "CombiTable1Ds: of the kinds of smoothness LinearSegments and ConstantSegments are available");
        for i in 1:nout loop
          y[i] = if lines then Modelica.Math.Vectors.interpolate(table[:, 1], table[:, columns[i]], at)
            else table[1, columns[i]]
              + sum(if at >= table[k, 1] then table[k, columns[i]] - table[k - 1, columns[i]] else 0 for k in 2:m);
        end for;
      end CombiTable1Ds;
      block CombiTable1Dv "Tables over one input each: lines or steps between their points"
        extends Modelica.Blocks.Interfaces.MIMOs(final n = size(columns, 1));
        parameter Boolean tableOnFile = false;
        parameter Real table[:, :] = fill(0.0, 0, 2);
        parameter String tableName = "NoName";
        parameter String fileName = "NoName";
        parameter Boolean verboseRead = true;
        parameter Integer columns[:] = 2:size(table, 2);
        parameter Modelica.Blocks.Types.Smoothness smoothness = Modelica.Blocks.Types.Smoothness.LinearSegments;
        parameter Modelica.Blocks.Types.Extrapolation extrapolation = Modelica.Blocks.Types.Extrapolation.LastTwoPoints;
        parameter Boolean verboseExtrapolation = false;
        final parameter Real u_min = table[1, 1];
        final parameter Real u_max = table[size(table, 1), 1];
      protected
        Modelica.Blocks.Tables.CombiTable1Ds single[n](each tableOnFile = tableOnFile, each table = table,
          columns = {{columns[i]} for i in 1:n}, each smoothness = smoothness, each extrapolation = extrapolation);
      equation
        for i in 1:n loop
          single[i].u = u[i];
          y[i] = single[i].y[1];
        end for;
      end CombiTable1Dv;
    end Tables;
  end Blocks;
end Modelica;
